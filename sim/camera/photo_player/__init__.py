"""Player of stored photos: `PhotoPlayer`, and what is known of each `Photo`."""

from sim.camera.photo_player.module import PhotoPlayer, PlayedPhoto
from sim.camera.photo_player.photo import Photo, PhotoError, open_photo, read_image
from sim.camera.photo_player.times import Cadence, Times, estimate_times

__all__ = [
    "Cadence",
    "Photo",
    "PhotoError",
    "PhotoPlayer",
    "PlayedPhoto",
    "Times",
    "estimate_times",
    "open_photo",
    "read_image",
]
