"""The mistakes that filters are known to hold, with what to look for. Their names are the keys of a report."""

from __future__ import annotations

from dataclasses import dataclass

MISTAKES = {
    "variance given as sigma": "a covariance stands where its factor or a standard deviation is expected",
    "sigma given as variance": "a factor or standard deviations stand where a covariance is expected",
    "transposed noise factor": "the factor enters as L' L; noise of covariance L L' needs rows L' under a QR",
    "wrong triangle": "the Cholesky factor is upper where lower is expected, or points are drawn along its rows",
    "correlations dropped": "the elements beside the diagonal are lost",
    "points not redrawn": "sigma points of the time update serve the measurement; they do not know the process noise",
    "wrong measurement sign": "innovation or measurement model has the opposite sign; take measured minus predicted",
    "double use of data": "one measurement enters twice, or an earlier one again; use each once and check freshness",
    "measurement at the wrong time": "the measurement meets a state of another time; predict to its time first",
    "measurement ignored": "neither estimate nor covariance takes notice of it",
    "covariance not updated": "the estimate moves but the covariance stays as predicted",
    "estimate not updated": "the covariance shrinks but the estimate stays as predicted",
    "missing process noise": "the covariance moves without it, so the filter grows deaf",
    "process noise not scaled with dt": "it is the same whatever the interval, or a density that was never integrated",
    "process noise scaled twice with dt": "the covariance of the interval is multiplied or divided by it once more",
    "process noise used twice": "it is added twice in one prediction",
    "process noise before the motion": "it is added first and moved along; it belongs to the end of the interval",
    "interval ignored": "the motion is that of another interval than the one asked for",
    "motion twice": "the motion is applied twice in one prediction",
    "motion backwards": "the motion has the sign of dt reversed",
    "transition transposed": "the covariance is moved as F' P F; it is F P F'",
    "covariance not moved": "process noise is added, but the covariance is not carried along by the motion",
    "first guess not taken": "it does not start from the first guess",
    "covariance not symmetric": "a triangle is left behind or rounding grows; symmetrise, or use Joseph's form",
    "covariance not positive": "digits are lost in P - K S K' or a downdate; use Joseph's form or a square root",
    "digits lost": "the arithmetic loses digits on badly scaled states; use Joseph's form or a square root",
    "not finite": "NaN or infinity in the result",
    "raises": "the filter stops with an error",
    "unexplained difference": "it differs from the right answer in none of the known ways; check model and derivatives",
    "overconfident": "errors are larger than the covariance says",
    "cautious": "errors are smaller than the covariance says",
    "biased": "innovations have a mean",
    "innovations not white": "innovations remember, so the gain is wrong or noise is modelled badly",
}
"""What each one means and what to do."""


@dataclass(frozen=True)
class Finding:
    """A verdict of one stage on one problem.

    Attributes:
        mistake: key of `MISTAKES`; empty if all is well.
        stage: "start", "prediction", "update", "endurance" or "runs".
        problem: its name.
        figure: what was measured, in words.
    """

    mistake: str
    stage: str
    problem: str
    figure: str

    def __str__(self) -> str:
        """Verdict, reason, figure."""
        where = f"{self.stage}, problem '{self.problem}'"
        if not self.mistake:
            return f"  well     {where}: {self.figure}"
        return (
            f"  MISTAKE  {self.mistake}\n           where:  {where}\n           reason: {MISTAKES[self.mistake]}\n"
            f"           figure: {self.figure}"
        )
