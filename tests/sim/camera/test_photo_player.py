"""Photos from files: times against simulated shutters, pixels against OpenCV, bad files."""

from __future__ import annotations

from collections.abc import Callable
from datetime import UTC, datetime
from pathlib import Path

import cv2
import numpy as np
import pytest
from PIL import Image

from fsw import Simulation, Task, s
from sim.camera.photo_player import (
    Cadence,
    PhotoError,
    PhotoPlayer,
    PlayedPhoto,
    estimate_times,
    open_photo,
    read_image,
)

PHOTOS = sorted((Path(__file__).parents[3] / "sim" / "data" / "iss_photos").glob("*.jpg"))
PASS = np.array([0, 12, 24, 36, 49, 61, 73, 85, 97, 109], float)
"""Stamps of the shipped photos, s."""


def save(path: Path, tags: dict[int, str], orientation: int | None = None) -> Path:
    picture = Image.fromarray(np.random.default_rng(1).integers(0, 255, (24, 32, 3), np.uint8))
    exif = Image.Exif()
    if orientation is not None:
        exif[0x0112] = orientation
    exif.get_ifd(0x8769).update(tags)
    picture.save(path, exif=exif, quality=95)
    return path


def player(*exposures_s: float) -> PhotoPlayer:
    photos = [
        PlayedPhoto(path=str(PHOTOS[k]), exposure_ns=s(t), earliest_ns=s(t - 0.5), latest_ns=s(t + 0.5), sigma_s=0.3)
        for k, t in enumerate(exposures_s)
    ]
    return PhotoPlayer("player", photos)


def test_shipped_photos_have_the_times_of_their_names() -> None:
    for path in PHOTOS:
        photo = open_photo(path)
        assert photo.stamp == datetime.strptime(path.stem[4:] + " +0000", "%Y%m%dT%H%M%S %z")
        assert (photo.width_px, photo.height_px, photo.resolution_s) == (1296, 972, 1.0)


def test_pixels_agree_with_opencv() -> None:
    flags = cv2.IMREAD_COLOR | cv2.IMREAD_IGNORE_ORIENTATION
    found = cv2.imread(str(PHOTOS[0]), flags)
    assert found is not None
    expected = found[..., ::-1]
    # two JPEG decoders may round differently
    assert np.abs(read_image(PHOTOS[0]).astype(int) - expected.astype(int)).max() <= 3


def test_orientation_is_not_applied(tmp_path: Path) -> None:
    path = save(tmp_path / "a.jpg", {0x9003: "2023:05:05 03:28:50"}, orientation=6)
    assert read_image(path).shape == (24, 32, 3)


def test_zone_and_parts_of_a_second_are_read(tmp_path: Path) -> None:
    tags = {0x9003: "2023:05:05 05:28:50", 0x9011: "+02:00", 0x9291: "25"}
    photo = open_photo(save(tmp_path / "a.jpg", tags))
    assert photo.stamp == datetime(2023, 5, 5, 3, 28, 50, 250000, tzinfo=UTC)
    assert photo.resolution_s == 0.01


@pytest.mark.parametrize(
    ("tags", "words"),
    [({}, "no time"), ({0x9003: "yesterday"}, "EXIF time 'yesterday'"), ({0x9003: "    "}, "no time")],
)
def test_photo_without_a_time_is_refused(tmp_path: Path, tags: dict[int, str], words: str) -> None:
    with pytest.raises(PhotoError, match=words):
        open_photo(save(tmp_path / "a.jpg", tags))


def test_files_that_are_no_image_are_refused(tmp_path: Path) -> None:
    (tmp_path / "text.jpg").write_text("no image")
    (tmp_path / "cut.jpg").write_bytes(PHOTOS[0].read_bytes()[:20000])
    (tmp_path / "empty.jpg").write_bytes(b"")
    for name in ("text.jpg", "cut.jpg", "empty.jpg"):
        with pytest.raises(PhotoError, match="no image, or damaged"):
            open_photo(tmp_path / name)
    with pytest.raises(PhotoError, match="no such file"):
        open_photo(tmp_path / "none.jpg")


def test_cadence_is_found_from_stamps_that_are_cut_off(criterion: Callable[[str, float], None]) -> None:
    """Simulated shutters: the true times are known; the error in sigmas stays below 3 of a uniform distribution."""
    rng = np.random.default_rng(5)
    worst = 0.0
    for _ in range(100):
        truth = rng.uniform(0, 1) + rng.uniform(5.0, 15.0) * np.arange(10)
        times = estimate_times(np.floor(truth), np.ones(10))
        assert times.cadence is not None and np.all(times.even)
        assert np.all(times.t_s >= times.earliest_s) and np.all(times.t_s <= times.latest_s)
        worst = max(worst, float(np.max(np.abs(times.t_s - truth) / times.sigma_s)))
    criterion("PLAYER-1", worst)


def test_shipped_stamps_give_a_cadence_near_twelve_seconds() -> None:
    times = estimate_times(PASS, np.ones(10))
    assert times.cadence is not None
    assert abs(times.cadence.period_s - 12.12) < 2.0 * times.cadence.sigma_s


def test_missing_photos_leave_the_cadence() -> None:
    truth = 0.3 + 6.06 * np.array([0, 3, 4, 9, 17])
    times = estimate_times(np.floor(truth), np.ones(5))
    assert times.cadence is not None and abs(times.cadence.period_s - 6.06) < 2.5 * times.cadence.sigma_s


def test_a_known_cadence_narrows_the_times() -> None:
    truth = 0.4 + 12.12 * np.arange(3)
    wide = estimate_times(np.floor(truth), np.ones(3))
    narrow = estimate_times(np.floor(truth), np.ones(3), Cadence(12.12, 0.005))
    assert wide.cadence is None and narrow.cadence is not None
    assert np.all(narrow.sigma_s < wide.sigma_s)


def test_half_the_spacing_of_a_known_cadence_is_recognised() -> None:
    truth = 0.4 + 6.06 * np.arange(8)
    times = estimate_times(np.floor(truth), np.ones(8), Cadence(12.12, 0.005))
    assert times.cadence is not None and times.cadence.period_s == pytest.approx(6.06, abs=0.005)


@pytest.mark.parametrize("stamps", [[7.0], [0.0, 5.0], [0.0, 5.0, 6.0, 50.0, 51.0, 57.0, 90.0]])
def test_without_an_even_cadence_the_middle_of_the_second_is_taken(stamps: list[float]) -> None:
    times = estimate_times(stamps, np.ones(len(stamps)))
    assert times.cadence is None and not np.any(times.even)
    np.testing.assert_allclose(times.t_s, np.array(stamps) + 0.5)
    np.testing.assert_allclose(times.sigma_s, 1.0 / np.sqrt(12.0))


def test_a_photo_of_another_orbit_does_not_spoil_the_cadence() -> None:
    times = estimate_times([*PASS, 5600.0], np.ones(11))
    np.testing.assert_array_equal(times.even, [True] * 10 + [False])


def test_photos_of_one_second_get_one_time() -> None:
    times = estimate_times([*PASS, PASS[3]], np.ones(11))
    assert times.t_s[10] == times.t_s[3] and times.even[10]


def test_order_of_the_photos_does_not_matter() -> None:
    order = np.random.default_rng(2).permutation(10)
    np.testing.assert_allclose(
        estimate_times(PASS[order], np.ones(10)).t_s, estimate_times(PASS, np.ones(10)).t_s[order]
    )


@pytest.mark.parametrize("stamps", [[], [[1.0]]])
def test_no_stamps_are_refused(stamps: list[float]) -> None:
    with pytest.raises(ValueError, match="at least one"):
        estimate_times(stamps, [1.0] * len(stamps) * 2)


def test_rounds_are_played_in_order_and_the_end_is_marked() -> None:
    source = player(0.5, 6.5)
    simulation = Simulation([Task("t", s(1), [source])])
    played = source.out_time.record()
    images = source.out_image.record()
    source.queue([1, 0])
    source.queue([1], attempt=2)
    simulation.run_until(s(5))
    np.testing.assert_array_equal(played["exposure_ns"], [s(6.5), s(0.5), s(6.5)])
    np.testing.assert_array_equal(played["attempt"], [0, 0, 2])
    np.testing.assert_array_equal(played["last"], [False, True, True])
    assert [m.label for m in images.objects] == [str(PHOTOS[k]) for k in (1, 0, 1)]
    assert images.objects[0].image.shape == (972, 1296, 3) and source.waiting == 0


def test_nothing_is_played_before_a_round_is_queued_and_reset_empties_the_queue() -> None:
    source = player(0.5, 6.5)
    simulation = Simulation([Task("t", s(1), [source])])
    simulation.run_until(s(1))
    assert source.out_time.latest() is None and source.out_image.latest() is None
    source.queue([0, 1])
    simulation.reset()
    assert source.waiting == 0


def test_bad_lists_are_refused() -> None:
    with pytest.raises(ValueError, match="same exposure time"):
        player(0.5, 0.5)
    with pytest.raises(ValueError, match="at least one photo"):
        PhotoPlayer("player", [])
    with pytest.raises(IndexError, match="no number 2"):
        player(0.5, 6.5).queue([2])
