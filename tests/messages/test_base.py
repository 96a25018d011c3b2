"""Declarations of messages: what they refuse, and what they yield."""

from typing import Annotated, Any

import msgspec
import numpy as np
import pytest

from fsw import (
    F64,
    I64,
    Bound,
    Mat3,
    Message,
    NanOk,
    ObjectMessage,
    Record,
    Shape,
    Vec3,
    eye,
    zeros,
)
from messages.base import dtype_of, fields_of, json_schema


class SampleMsg(Message):
    """A message with one field of every kind."""

    r_BN_N: Annotated[Vec3, "m", "position of B relative to N"]
    mass: Annotated[float, "kg", "mass", Bound(gt=0)] = 1.0
    count: Annotated[int, "-", "number of things", Bound(ge=0, le=9)] = 0
    valid: Annotated[bool, "-", "usable"] = True
    inertia_B: Annotated[Mat3, "kg*m^2", "inertia"] = eye(3)
    ids: Annotated[I64, Shape(2), "-", "identifiers"] = np.zeros(2, np.int64)
    age: Annotated[float, "s", "age, NaN if unknown", NanOk()] = float("nan")


class PictureMsg(ObjectMessage):
    """An object."""

    image: Annotated[Any, "-", "pixels"]


GOOD: Any = {"r_BN_N": [1.0, 2.0, 3.0]}


def test_a_message_is_immutable_and_owns_its_arrays() -> None:
    mine = np.array([1.0, 2.0, 3.0])
    message = SampleMsg(r_BN_N=mine)
    mine[0] = 99.0
    assert message.r_BN_N[0] == 1.0
    with pytest.raises(ValueError, match="read-only"):
        message.r_BN_N[0] = 5.0
    with pytest.raises(AttributeError):
        message.mass = 2.0  # type: ignore[misc]


def test_a_view_of_a_writable_array_is_copied() -> None:
    base = np.zeros(6)
    view = base[:3]
    view.setflags(write=False)
    message = SampleMsg(r_BN_N=view)
    base[0] = 7.0
    assert message.r_BN_N[0] == 0.0


@pytest.mark.parametrize(
    ("wrong", "words"),
    [
        ({"r_BN_N": [1.0, 2.0]}, ["SampleMsg.r_BN_N", "(3,)", "[m]", "shape (2,)"]),
        ({"r_BN_N": 3.0}, ["r_BN_N", "shape ()"]),
        ({"r_BN_N": [1.0, float("nan"), 0.0]}, ["r_BN_N", "NaN"]),
        ({"r_BN_N": np.array([1.0, np.inf, 0.0])}, ["r_BN_N", "infinity"]),
        ({"r_BN_N": [np.inf, -np.inf, 0.0]}, ["r_BN_N", "infinity"]),
        ({"r_BN_N": "abc"}, ["r_BN_N", "str abc"]),
        ({"r_BN_N": ["1", "2", "3"]}, ["r_BN_N", "list"]),
        ({"r_BN_N": [1 + 2j, 0, 0]}, ["r_BN_N", "list"]),
        ({"r_BN_N": None}, ["r_BN_N", "None"]),
        ({"mass": -1.0}, ["mass", "[kg]", "> 0"]),
        ({"mass": float("nan")}, ["mass", "NaN"]),
        ({"mass": float("inf")}, ["mass", "infinity"]),
        ({"mass": True}, ["mass", "bool"]),
        ({"mass": "3"}, ["mass", "str"]),
        ({"count": 2.5}, ["count", "float"]),
        ({"count": 10}, ["count", "<= 9"]),
        ({"count": 2**70}, ["count", "64 bits"]),
        ({"valid": 1}, ["valid", "int"]),
        ({"inertia_B": np.eye(2)}, ["inertia_B", "(3, 3)", "shape (2, 2)"]),
        ({"ids": [0.5, 1.0]}, ["ids", "list"]),
        ({"age": float("inf")}, ["age", "infinity"]),
    ],
)
def test_wrong_values_are_refused_by_name(wrong: dict[str, Any], words: list[str]) -> None:
    with pytest.raises(ValueError, match="expected") as caught:
        SampleMsg(**{**GOOD, **wrong})
    for word in words:
        assert word in str(caught.value)


def test_missing_unknown_and_positional_arguments_are_refused() -> None:
    with pytest.raises(TypeError, match="r_BN_N"):
        SampleMsg()  # type: ignore[call-arg]
    with pytest.raises(TypeError, match="velocity"):
        SampleMsg(**GOOD, velocity=1.0)  # type: ignore[arg-type]
    with pytest.raises(TypeError):
        SampleMsg([1.0, 2.0, 3.0])  # type: ignore[call-arg,arg-type,misc]


def test_numbers_of_numpy_and_integers_become_what_is_declared() -> None:
    message = SampleMsg(r_BN_N=np.array([1, 2, 3]), mass=np.float64(2), count=np.int64(3))  # type: ignore[arg-type]
    assert message.r_BN_N.dtype == np.float64
    assert type(message.mass) is float and type(message.count) is int
    assert SampleMsg(**GOOD, mass=3).mass == 3.0 and np.isnan(SampleMsg(**GOOD).age)


def test_the_row_is_aligned_and_begins_with_the_header() -> None:
    row = dtype_of(SampleMsg)
    assert row.names is not None and row.names[:3] == ("t_ns", "seq", "r_BN_N")
    assert row.isalignedstruct and row.itemsize % 8 == 0
    assert row["r_BN_N"].shape == (3,) and row["valid"].kind == "b" and row["ids"].base == np.int64
    assert dtype_of(PictureMsg).names == ("t_ns", "seq")


def test_fields_carry_unit_and_description() -> None:
    field = fields_of(SampleMsg)[0]
    assert (field.unit, field.description, field.shape, field.default) == (
        "m",
        "position of B relative to N",
        (3,),
        msgspec.NODEFAULT,
    )


def test_json_schema_says_shapes_units_and_what_is_required() -> None:
    schema = json_schema(SampleMsg)
    assert schema["required"] == ["r_BN_N"]
    matrix = schema["properties"]["inertia_B"]
    assert (matrix["minItems"], matrix["items"]["maxItems"], matrix["unit"]) == (3, 3, "kg*m^2")
    assert schema["properties"]["valid"]["type"] == "boolean"


@pytest.mark.parametrize(
    ("annotation", "words"),
    [
        (float, "0 texts"),
        (Annotated[float, "m"], "1 texts"),
        (Annotated[str, "-", "a name"], "ObjectMessage"),
        (Annotated[F64, "m", "no shape"], "Shape"),
        (Annotated[float, Shape(3), "m", "a shape too many"], "Shape"),
    ],
)
def test_a_bad_declaration_is_named(annotation: Any, words: str) -> None:
    class BadMsg(Record):
        x: annotation  # pyright: ignore[reportInvalidTypeForm]

    with pytest.raises(TypeError, match=r"BadMsg\.x") as caught:
        fields_of(BadMsg)
    assert words in str(caught.value)


def test_an_object_message_takes_anything_and_freezes_its_arrays() -> None:
    picture = PictureMsg(image=np.zeros((2, 2), np.uint8))
    with pytest.raises(ValueError, match="read-only"):
        picture.image[0, 0] = 1


def test_defaults_are_read_only() -> None:
    with pytest.raises(ValueError, match="read-only"):
        zeros(3)[0] = 1.0
