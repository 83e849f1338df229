"""A group of cameras with a common world frame."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from muybridge.arrays import FloatArray
from muybridge.geometry.cameras.camera import Camera


@dataclass(frozen=True)
class CameraGroup:
    """The cameras of one take, in the order of every array's `C` axis.

    Raises:
        ValueError: no camera, or two with the same name.
    """

    cameras: tuple[Camera, ...]

    def __post_init__(self) -> None:
        object.__setattr__(self, "cameras", tuple(self.cameras))
        if not self.cameras:
            raise ValueError("a camera group needs at least one camera")
        repeated = sorted({n for n in self.names if self.names.count(n) > 1})
        if repeated:
            raise ValueError(f"camera names repeat: {', '.join(repeated)}")

    @property
    def names(self) -> tuple[str, ...]:
        """The cameras' names, in order."""
        return tuple(camera.name for camera in self.cameras)

    def __len__(self) -> int:
        return len(self.cameras)

    def __iter__(self) -> Iterator[Camera]:
        return iter(self.cameras)

    def __contains__(self, name: object) -> bool:
        return name in self.names

    def __getitem__(self, key: str | int) -> Camera:
        """A camera by name (KeyError lists the names) or by index."""
        if isinstance(key, str):
            for camera in self.cameras:
                if camera.name == key:
                    return camera
            raise KeyError(f"no camera {key!r}; the cameras are {', '.join(self.names)}")
        return self.cameras[key]

    @property
    def cam_from_world(self) -> FloatArray:
        """(C, 3, 4) poses, metres."""
        return np.stack([camera.cam_from_world for camera in self.cameras])

    @property
    def centers_world(self) -> FloatArray:
        """(C, 3) centres of projection, metres."""
        return np.stack([camera.center_world for camera in self.cameras])

    def project(self, points_world: ArrayLike) -> FloatArray:
        """(..., 3) world points to (C, ..., 2) px, as `Camera.project`."""
        world = np.asarray(points_world, dtype=np.float64)
        return np.stack([camera.project(world) for camera in self.cameras])

    def project_seen(self, points_world: ArrayLike) -> FloatArray:
        """(..., 3) world points to (C, ..., 2) px, as `Camera.project_seen`."""
        world = np.asarray(points_world, dtype=np.float64)
        return np.stack([camera.project_seen(world) for camera in self.cameras])

    def unproject(self, points_px: ArrayLike) -> FloatArray:
        """(C, ..., 2) px to (C, ..., 2) normalised coordinates, as `Camera.unproject`.

        Raises:
            ValueError: the first axis is not the number of cameras.
        """
        px = np.asarray(points_px, dtype=np.float64)
        if px.ndim < 2 or px.shape[0] != len(self):
            raise ValueError(f"points_px must be ({len(self)}, ..., 2), not {px.shape}")
        return np.stack([camera.unproject(p) for camera, p in zip(self.cameras, px, strict=True)])

    def select(self, names: Sequence[str]) -> CameraGroup:
        """The named cameras, in the order of `names`; KeyError for a name that is none of them."""
        return CameraGroup(tuple(self[name] for name in names))
