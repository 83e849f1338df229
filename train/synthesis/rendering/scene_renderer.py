"""Rendering of scenes: several people and things in one picture, with labels of one of them."""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import cv2
import numpy as np
from numpy.typing import NDArray

from muybridge.arrays import BoolArray, ByteArray, Float32Array
from muybridge.geometry.landmarks.marker_sets import SURFACE
from muybridge.train.synthesis.bodies.body_model import BODY_VERTICES
from muybridge.train.synthesis.clothing.sample import Outfit
from muybridge.train.synthesis.rendering.labels import (
    Render,
    Shape,
    clip_near,
    expose,
    landmark_labels,
    marker_labels,
    read_depth,
    read_pixels,
)
from muybridge.train.synthesis.rendering.renderer import Lighting, Renderer
from muybridge.train.synthesis.rendering.thing_buffers import ThingBuffers
from muybridge.train.synthesis.rendering.view import FAR, NEAR, View
from muybridge.train.synthesis.things.scene import Scene

# Whom each pixel shows.
OwnerArray = NDArray[np.int16]

OTHERS = 4  # people besides the subject whose boxes are kept
# Owners of pixels besides people, who have their numbers.
NOBODY, THING = -1, 100
_HORIZON = 0.999 * FAR  # metres; beyond it nothing is drawn
_BEYOND = 1200  # pixels on either side of the image's corner in which a body is counted


@dataclass(frozen=True, kw_only=True)
class SceneRender(Render):
    """Image of a scene, and labels of the person whom it is about; NaN and hidden where nobody is there.

    `rgba` and `shadow` are those of everything; `visible` and `markers_visible` are False where another person or a
    thing hides the point.

    Attributes:
        things: (H, W) uint8, the share of the pixel that is a thing; at most its alpha.
        others_px: (OTHERS, 4) boxes of other people, left, top, right, bottom, also outside the image; NaN padded.
        others_visible: (OTHERS,) share of each that is in the image and not hidden; 0 where there is nobody.
        kind: of the scene.
    """

    things: ByteArray
    others_px: Float32Array = field(default_factory=lambda: np.full((OTHERS, 4), np.nan, np.float32))
    others_visible: Float32Array = field(default_factory=lambda: np.zeros(OTHERS, np.float32))
    kind: str = ""


def share_light(outfits: Sequence[Outfit]) -> list[Outfit]:
    """The same outfits, all in the light of the first."""
    first = outfits[0]
    names = ("light_colour", "fill", "fill_colour", "ambient_up", "ambient_down")
    light = {k: first.values[k] for k in names}
    return [replace(o, light=first.light, sky=first.sky, values=o.values | light) for o in outfits]


class SceneRenderer:
    """Draws scenes with a `Renderer`, whose loaded person it changes.

    Args:
        renderer: of the body model that the people stem from.
    """

    def __init__(self, renderer: Renderer) -> None:
        self.renderer = renderer
        self._things = ThingBuffers(renderer)

    def load(self, scene: Scene) -> None:
        """Draw `scene` from now on."""
        self.scene = scene
        self._shapes = [self.renderer.shape(p.vertices) for p in scene.people]
        self._things.load(scene.things)

    def render(self, view: View, outfits: Sequence[Outfit], subject: int = 0) -> SceneRender:
        """Render the loaded scene; the floor is at z = 0.

        Args:
            view: the camera.
            outfits: of each person; the light is that of the first one. A scene without people needs one, for its
                light.
            subject: number of the person whose labels are wanted.
        """
        outfits = share_light(outfits)
        points = np.concatenate(
            [p.vertices[:BODY_VERTICES] for p in self.scene.people] + [t.vertices_world for t in self.scene.things]
        )
        center = ((points.min(0) + points.max(0)) / 2).astype(float)
        lighting = Lighting.around(center, float(np.linalg.norm(points - center, axis=1).max()), outfits[0])
        values = lighting.uniforms(view)
        self.renderer.bind_textures()
        target, mask, depth = self.renderer.target(view.width, view.height)
        self._draw_shadows(view, outfits, lighting, mask)
        owner, metres = self._draw_colours(view, outfits, values, target, depth)
        rgba, shadow = read_pixels(view, target), read_pixels(view, mask)
        people = (owner != NOBODY) & (owner != THING)
        expose(rgba, people if people.any() else owner != NOBODY)
        rgba, things = _antialias(rgba, owner)
        if not self.scene.people:
            return _nobody(rgba, shadow, things)
        shape = self._shapes[subject]
        landmarks = self.scene.people[subject].landmarks
        px, visible, box = landmark_labels(view, shape, metres, landmarks)
        markers_px, markers_visible = marker_labels(view, shape, metres)
        visible &= ~_covered(view, landmarks, metres, owner, subject)
        markers_visible &= ~_covered(view, shape.markers, metres, owner, subject)
        boxes, shares = self._others(view, owner, subject)
        return SceneRender(
            rgba, shadow, px, visible, box, markers_px, markers_visible,
            things=things, others_px=boxes, others_visible=shares,
        )  # fmt: skip

    def _wear(self, person: int, outfit: Outfit) -> None:
        self.renderer.use(self._shapes[person])
        self.renderer.dress(outfit)

    def _draw_shadows(self, view: View, outfits: list[Outfit], lighting: Lighting, mask: object) -> None:
        """Fill the shadow maps, and the target of shadows on the floor."""
        r = self.renderer
        cast = {"clip_from_world": view.clip_from_world @ lighting.shear}
        for target in r.shadow_targets:
            target.clear(depth=1.0)
        mask.clear(0, 0, 0, 0)  # type: ignore[attr-defined]
        for person in range(len(self._shapes) + 1):
            things = person == len(self._shapes)
            if not things:
                self._wear(person, outfits[person])
            common = lighting.uniforms(view) | ({} if things else outfits[person].uniforms())
            r.ctx.enable(r.gl.DEPTH_TEST)
            for target, lamp in zip(r.shadow_targets, lighting.lamps, strict=True):
                target.use()
                lit = common | {"light_clip_from_world": lamp}
                if things:
                    r.ctx.disable(r.gl.CULL_FACE)
                    self._things.draw("depth", lit)
                else:
                    r.draw("depth", outfits[person], lit)
            r.ctx.disable(r.gl.DEPTH_TEST)
            mask.use()  # type: ignore[attr-defined]
            if things:
                self._things.draw("mask", common | cast)
            else:
                r.draw("mask", outfits[person], common | cast)

    def _draw_colours(
        self, view: View, outfits: list[Outfit], values: dict[str, object], target: object, depth: object
    ) -> tuple[OwnerArray, Float32Array]:
        """Draw everything; return whom each pixel (H, W) shows, and its depth in metres."""
        r = self.renderer
        r.ctx.enable(r.gl.DEPTH_TEST)
        target.use()  # type: ignore[attr-defined]
        target.clear(0, 0, 0, 0, depth=1.0)  # type: ignore[attr-defined]
        owner = np.full((view.height, view.width), NOBODY, np.int16)
        metres = np.full(owner.shape, np.inf, np.float32)

        def claim(number: int) -> None:
            now = read_depth(view, depth)
            owner[now < np.minimum(metres, _HORIZON)] = number
            metres[:] = now

        for person, outfit in enumerate(outfits[: len(self._shapes)]):
            if len(self._shapes) > 1:
                self._wear(person, outfit)
            r.draw_person(outfit, outfit.uniforms() | values, view)
            claim(person)
        if self.scene.things:
            r.ctx.disable(r.gl.CULL_FACE)
            self._things.draw("colour", outfits[0].uniforms() | values)
            claim(THING)
        return owner, metres

    def _others(self, view: View, owner: OwnerArray, subject: int) -> tuple[Float32Array, Float32Array]:
        """Boxes (OTHERS, 4) and visible shares (OTHERS,) of the people besides the subject, the most visible first."""
        boxes, shares = np.full((OTHERS, 4), np.nan, np.float32), np.zeros(OTHERS, np.float32)
        found = [_extent(view, s, owner, k) for k, s in enumerate(self._shapes) if k != subject]
        shown = sorted((f for f in found if f is not None), key=lambda f: -f[1])[:OTHERS]
        for k, (box, share) in enumerate(shown):
            boxes[k], shares[k] = box, share
        return boxes, shares


def _extent(view: View, shape: Shape, owner: OwnerArray, person: int) -> tuple[Float32Array, float] | None:
    """Box (4,) of a person and the share of the pixels that the body covers where the person is seen; None if part of
    the body is behind the camera."""
    px, depth_m = view.project(shape.vertices[:BODY_VERTICES])
    if depth_m.min() < NEAR:
        return None
    at = np.round(px[::2]).clip(-_BEYOND, _BEYOND).astype(np.intp)
    corner = at.min(0) - 1
    covered = np.zeros((np.ptp(at, axis=0) + 3)[::-1], np.uint8)
    covered[at[:, 1] - corner[1], at[:, 0] - corner[0]] = 1
    covered = cv2.morphologyEx(covered, cv2.MORPH_CLOSE, np.ones((3, 3), np.uint8))  # pixels between vertices
    y, x = np.nonzero(covered)
    x, y = x + corner[0], y + corner[1]
    inside = (x >= 0) & (x < owner.shape[1]) & (y >= 0) & (y < owner.shape[0])
    share = (owner[y[inside], x[inside]] == person).sum() / len(x)
    return np.concatenate([px.min(0), px.max(0)]).astype(np.float32), float(share)


def _covered(
    view: View, points_world: Float32Array, metres: Float32Array, owner: OwnerArray, subject: int
) -> BoolArray:
    """(J,) whether most of the 3 x 3 pixels around `points_world` (J, 3) show somebody else or a thing before them."""
    px, depth_m = clip_near(*view.project(points_world))
    x, y = np.round(px).astype(int).clip(1, np.array(owner.shape[::-1]) - 2).T
    count = np.zeros(len(px), int)
    for i, j in np.ndindex(3, 3):
        rows, columns = y + j - 1, x + i - 1
        whose = owner[rows, columns]
        count += (whose != NOBODY) & (whose != subject) & (metres[rows, columns] < depth_m)
    return np.asarray(count > 4)


def _antialias(rgba: ByteArray, owner: OwnerArray) -> tuple[ByteArray, ByteArray]:
    """Smooth the outlines of everybody and everything; return the share of things (H, W), too."""
    things = np.where(owner == THING, 255, 0).astype(np.uint8)
    planes = np.concatenate([rgba, things[..., None]], 2)
    smooth = cv2.GaussianBlur(planes, (3, 3), 0.65)
    square = np.ones((3, 3), np.uint8)
    edge = cv2.dilate(owner, square) != cv2.erode(owner, square)
    planes[edge] = smooth[edge]
    return planes[..., :4].copy(), np.minimum(planes[..., 4], planes[..., 3])


def _nobody(rgba: ByteArray, shadow: ByteArray, things: ByteArray) -> SceneRender:
    """A render without a person."""
    nan, count = np.full((max(23, len(SURFACE)), 4), np.nan, np.float32), len(SURFACE)
    hidden = np.zeros(max(23, count), bool)
    return SceneRender(rgba, shadow, nan[:23, :2], hidden[:23], nan[0], nan[:count, :2], hidden[:count], things=things)
