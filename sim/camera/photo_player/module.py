"""A camera that plays photos from files."""

from __future__ import annotations

from collections.abc import Sequence

import msgspec

from fsw import Module, Out
from messages.opnav import CameraImageMsg
from messages.orbit import PhotoTimeMsg
from sim.camera.photo_player.photo import PhotoError, read_image


class PlayedPhoto(msgspec.Struct, frozen=True, kw_only=True):
    """A photo to be played: ``path`` of its file, and times as in `PhotoTimeMsg`, ns and s."""

    path: str
    exposure_ns: int
    earliest_ns: int
    latest_ns: int
    sigma_s: float
    even: bool = False


class PhotoPlayer(Module):
    """Plays stored photos, one a step, as often and in the order it is told. See SPEC.md."""

    shared = ("photos", "_paths")
    out_time = Out(PhotoTimeMsg)
    out_image = Out(CameraImageMsg)

    def __init__(self, name: str, photos: Sequence[PlayedPhoto]) -> None:
        """Take the list of photos; nothing is played before `queue` is called.

        Raises:
            ValueError: if two photos have the same exposure time, which names a photo downstream, or there is none.
        """
        super().__init__(name)
        self.photos = tuple(photos)
        if not self.photos:
            raise ValueError(f"PhotoPlayer {name!r}: expected at least one photo, got none")
        times = [p.exposure_ns for p in self.photos]
        for photo in self.photos:
            if times.count(photo.exposure_ns) > 1:
                text = f"{photo.path} has the same exposure time as another photo; leave one of them out"
                raise ValueError(f"PhotoPlayer {name!r}: {text}")
        self._paths = {p.exposure_ns: p.path for p in self.photos}
        self._waiting: list[PhotoTimeMsg] = []

    def queue(self, indices: Sequence[int], attempt: int = 0, *, calibrate: bool = False) -> None:
        """Add a round: the photos of these indices, in this order.

        Args:
            indices: into `photos`. attempt: for how many rounds these photos have failed before.
            calibrate: whether lens, mounting and clock are to be estimated at the end of the round.

        Raises:
            IndexError: if there is no such photo.
        """
        for i in indices:
            if not 0 <= i < len(self.photos):
                raise IndexError(f"PhotoPlayer {self.name!r}: there are {len(self.photos)} photos, no number {i}")
        for k, i in enumerate(indices):
            photo = self.photos[i]
            self._waiting.append(
                PhotoTimeMsg(
                    exposure_ns=photo.exposure_ns,
                    earliest_ns=photo.earliest_ns,
                    latest_ns=photo.latest_ns,
                    sigma_s=photo.sigma_s,
                    even=photo.even,
                    attempt=attempt,
                    last=k == len(indices) - 1,
                    calibrate=calibrate,
                )
            )

    @property
    def waiting(self) -> int:
        """How many photos are still to be played."""
        return len(self._waiting)

    def step(self, t_ns: int) -> None:
        """Publish the next photo and its time, or nothing if none waits."""
        if not self._waiting:
            return
        time = self._waiting.pop(0)
        path = self._paths[time.exposure_ns]
        try:
            image = read_image(path)
        except PhotoError as error:
            raise PhotoError(f"{path}: {error}; it could be read when the run began") from error
        self.out_time.write(time, t_ns)
        self.out_image.write(CameraImageMsg(image=image, exposure_ns=time.exposure_ns, label=path), t_ns)
