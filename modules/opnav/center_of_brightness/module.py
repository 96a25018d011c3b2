"""CenterOfBrightness: where the light of a body has its centre."""

from __future__ import annotations

from typing import Annotated

from fsw import Bound, In, Module, Out, Record
from messages.opnav import CameraImageMsg, OpNavBrightnessMsg
from modules.opnav.center_of_brightness.kernel import FOUND, centre_of_light


class CenterOfBrightness(Module):
    """Finds the centre of brightness of the brightest patch of an image. See SPEC.md."""

    class Params(Record):
        """Parameters."""

        body_id: Annotated[int, "-", "NAIF identifier of the body that the light is taken for"]
        contrast: Annotated[float, "-", "least grey levels above the background", Bound(gt=0)] = 15.0
        blur: Annotated[int, "px", "width of the box blur, odd", Bound(ge=1, le=99)] = 5
        min_area: Annotated[float, "px^2", "smallest lit area", Bound(gt=0)] = 4.0
        sigma_floor: Annotated[float, "px", "standard deviation of a coordinate without noise", Bound(gt=0)] = 0.05

        def __post_init__(self) -> None:
            """Check that the box has a middle."""
            super().__post_init__()
            if self.blur % 2 == 0:
                raise ValueError(f"CenterOfBrightness.Params.blur: expected an odd number, got {self.blur}; add 1")

    in_image = In(CameraImageMsg)
    out_brightness = Out(OpNavBrightnessMsg)
    params: Params

    def step(self, t_ns: int) -> None:
        """Look at each new image once."""
        image = self.in_image.take()
        if image is None:
            return
        p = self.params
        light = centre_of_light(image.image, p.contrast, p.blur, p.min_area, p.sigma_floor)
        self.out_brightness.write(
            OpNavBrightnessMsg(
                exposure_ns=image.exposure_ns,
                valid=light.status == FOUND,
                status=light.status,
                body_id=p.body_id,
                center_px=light.center_px,
                P_px=light.P_px,
                area_px=light.area_px,
            ),
            t_ns,
        )
