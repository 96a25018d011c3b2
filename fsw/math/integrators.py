"""The explicit Runge-Kutta pair of order 8(5,3) of Dormand and Prince with dense output of order 7, in place.

Hairer, Norsett and Wanner, "Solving Ordinary Differential Equations I", 2nd ed., sec. II.5, II.6 and II.10; the
coefficients are those of the authors' program DOP853 (E. Hairer, G. Wanner, University of Geneva, 2-clause BSD).
The right-hand side is ``slope(t, y, out, args)``: it writes dy/dt (n,) at ``t`` s into ``out``; ``args`` is its own.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any, TypeAlias

import numpy as np

from fsw.math.compiled import compiled
from messages.base import F64

Slope: TypeAlias = Callable[[float, F64, F64, Any], None]

STAGES = 16
"""Rows of the work space ``k`` (16, n): 12 stages, the slope at the end, three more for the dense output."""
DENSE = 8
"""Rows of ``dense`` (8, n): the start and seven coefficients."""


def _rows(text: str, width: int) -> F64:
    """Rows of ``column:value`` words; a line that is indented continues the row."""
    lines = text.strip("\n").replace("\n    ", " ").splitlines()
    table = np.zeros((len(lines), width))
    for row, line in zip(table, lines, strict=True):
        for column, _, value in (word.partition(":") for word in line.split() if word != "-"):
            row[int(column)] = float(value)
    return table


# the rows of stages; row 12 gives the result
_A = _rows(
    """
-
0:0.05260015195876773
0:0.0197250569845379 1:0.0591751709536137
0:0.02958758547680685 2:0.08876275643042054
0:0.2413651341592667 2:-0.8845494793282861 3:0.924834003261792
0:0.037037037037037035 3:0.17082860872947386 4:0.12546768756682242
0:0.037109375 3:0.17025221101954405 4:0.06021653898045596 5:-0.017578125
0:0.03709200011850479 3:0.17038392571223998 4:0.10726203044637328 5:-0.015319437748624402 6:0.008273789163814023
0:0.6241109587160757 3:-3.3608926294469414 4:-0.868219346841726 5:27.59209969944671 6:20.154067550477894
    7:-43.48988418106996
0:0.47766253643826434 3:-2.4881146199716677 4:-0.590290826836843 5:21.230051448181193 6:15.279233632882423
    7:-33.28821096898486 8:-0.020331201708508627
0:-0.9371424300859873 3:5.186372428844064 4:1.0914373489967295 5:-8.149787010746927 6:-18.52006565999696
    7:22.739487099350505 8:2.4936055526796523 9:-3.0467644718982196
0:2.273310147516538 3:-10.53449546673725 4:-2.0008720582248625 5:-17.9589318631188 6:27.94888452941996
    7:-2.8589982771350235 8:-8.87285693353063 9:12.360567175794303 10:0.6433927460157636
0:0.054293734116568765 5:4.450312892752409 6:1.8915178993145003 7:-5.801203960010585 8:0.3111643669578199
    9:-0.1521609496625161 10:0.20136540080403034 11:0.04471061572777259
0:0.056167502283047954 6:0.25350021021662483 7:-0.2462390374708025 8:-0.12419142326381637 9:0.15329179827876568
    10:0.00820105229563469 11:0.007567897660545699 12:-0.008298
0:0.03183464816350214 5:0.028300909672366776 6:0.053541988307438566 7:-0.05492374857139099
    10:-0.00010834732869724932 11:0.0003825710908356584 12:-0.00034046500868740456 13:0.1413124436746325
0:-0.42889630158379194 5:-4.697621415361164 6:7.683421196062599 7:4.06898981839711 8:0.3567271874552811
    12:-0.0013990241651590145 13:2.9475147891527724 14:-9.15095847217987
""",
    STAGES,
)
_C = _rows(
    """
1:0.05260015195876773 2:0.0789002279381516 3:0.1183503419072274 4:0.2816496580927726 5:0.3333333333333333 6:0.25
    7:0.3076923076923077 8:0.6512820512820513 9:0.6 10:0.8571428571428571 11:1.0 12:1.0 13:0.1 14:0.2
    15:0.7777777777777778
""",
    STAGES,
)[0]
# errors of order 3 and 5, and the last four coefficients of the dense output
_E3, _E5 = _rows(
    """
0:-0.18980075407240762 5:4.450312892752409 6:1.8915178993145003 7:-5.801203960010585 8:-0.4226823213237919
    9:-0.1521609496625161 10:0.20136540080403034 11:0.02265179219836082
0:0.01312004499419488 5:-1.2251564463762044 6:-0.4957589496572502 7:1.6643771824549864 8:-0.35032884874997366
    9:0.3341791187130175 10:0.08192320648511571 11:-0.022355307863886294
""",
    STAGES,
)
_D = _rows(
    """
0:-8.428938276109013 5:0.5667149535193777 6:-3.0689499459498917 7:2.38466765651207 8:2.117034582445028
    9:-0.871391583777973 10:2.2404374302607883 11:0.6315787787694688 12:-0.08899033645133331
    13:18.148505520854727 14:-9.194632392478356 15:-4.436036387594894
0:10.427508642579134 5:242.28349177525817 6:165.20045171727028 7:-374.5467547226902 8:-22.113666853125306
    9:7.733432668472264 10:-30.674084731089398 11:-9.332130526430229 12:15.697238121770845
    13:-31.139403219565178 14:-9.35292435884448 15:35.81684148639408
0:19.985053242002433 5:-387.0373087493518 6:-189.17813819516758 7:527.8081592054236 8:-11.57390253995963
    9:6.8812326946963 10:-1.0006050966910838 11:0.7777137798053443 12:-2.778205752353508 13:-60.19669523126412
    14:84.32040550667716 15:11.99229113618279
0:-25.69393346270375 5:-154.18974869023643 6:-231.5293791760455 7:357.6391179106141 8:93.40532418362432
    9:-37.45832313645163 10:104.0996495089623 11:29.8402934266605 12:-43.53345659001114 13:96.32455395918828
    14:-39.17726167561544 15:-149.72683625798564
""",
    STAGES,
)


@compiled
def _stage(i: int, slope: Slope, t: float, h: float, y: F64, k: F64, at: F64, args: Any) -> None:
    """Stage ``i`` into its row of ``k``; ``at`` (n,) is overwritten by the point where it is taken."""
    for j in range(len(y)):
        at[j] = 0.0
    for s in range(i):
        weight = _A[i, s]
        if weight != 0.0:
            for j in range(len(y)):
                at[j] += weight * k[s, j]
    for j in range(len(y)):
        at[j] = y[j] + h * at[j]
    slope(t + _C[i] * h, at, k[i], args)


@compiled
def dop853_step(slope: Slope, t: float, h: float, y: F64, k: F64, end: F64, args: Any) -> None:
    """One step of ``h`` s from ``y`` (n,) at ``t``, whose slope is in ``k[0]``: into ``end`` (n,) and ``k`` (16, n)."""
    for i in range(1, 13):
        _stage(i, slope, t, h, y, k, end, args)


@compiled
def dop853_error(h: float, k: F64, tolerance: F64) -> float:
    """Estimated error of a step in units of ``tolerance`` (n,), root mean square: at most 1 is good."""
    sum3, sum5 = 0.0, 0.0
    for j in range(k.shape[1]):
        e3, e5 = 0.0, 0.0
        for i in range(13):
            e3 += _E3[i] * k[i, j]
            e5 += _E5[i] * k[i, j]
        sum3 += (e3 / tolerance[j]) ** 2
        sum5 += (e5 / tolerance[j]) ** 2
    if sum5 == 0.0:
        return 0.0
    return abs(h) * sum5 / math.sqrt((sum5 + 0.01 * sum3) * k.shape[1])


@compiled
def dop853_factor(error: float) -> float:
    """By what to multiply the step after an error in units of the tolerance."""
    if not error >= 0.0:
        return 0.1  # NaN: the step led out of where the slope is defined
    return min(6.0, max(0.2, 0.9 * error ** (-1.0 / 8.0))) if error > 0.0 else 6.0


@compiled
def dop853_dense(slope: Slope, t: float, h: float, y: F64, k: F64, end: F64, dense: F64, args: Any) -> None:
    """Coefficients of the interpolant of a step, into ``dense`` (8, n); rows 13 to 15 of ``k`` are overwritten."""
    for j in range(len(y)):
        change = end[j] - y[j]
        dense[0, j], dense[1, j] = y[j], change
        dense[2, j] = h * k[0, j] - change
        dense[3, j] = 2.0 * change - h * (k[12, j] + k[0, j])
    for i in range(13, STAGES):
        _stage(i, slope, t, h, y, k, end, args)
    for j in range(len(y)):
        end[j] = dense[0, j] + dense[1, j]
        for row in range(4):
            total = 0.0
            for i in range(STAGES):
                total += _D[row, i] * k[i, j]
            dense[4 + row, j] = h * total


@compiled
def dop853_value(dense: F64, x: float, out: F64) -> None:
    """The interpolant at the fraction ``x`` of the step, 0 to 1, into ``out`` (n,)."""
    for j in range(len(out)):
        value = 0.0
        for i in range(7):
            value = (value + dense[7 - i, j]) * (x if i % 2 == 0 else 1.0 - x)
        out[j] = dense[0, j] + value
