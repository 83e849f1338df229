"""Camera faults: defocus, motion blur, low resolution, colour, tone, noise, compression."""

from collections.abc import Collection
from fractions import Fraction

import av
import cv2
import kornia
import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from muybridge.arrays import BoolArray, ByteArray, Float32Array, FloatArray

_NOISE = 1 << 21  # length of the stored noise


class CameraFaults:
    """Random image formation on batches.

    Args:
        rng: source of random numbers.
    """

    def __init__(self, rng: np.random.Generator) -> None:
        self.rng = rng
        # Drawing new noise for every pixel would take as long as everything else together.
        self._noise = torch.from_numpy(rng.standard_normal(_NOISE, np.float32))

    def grain(self, size: int) -> Tensor:
        """(size,) Gaussian noise of unit variance: a random part of a stored array, not to be modified."""
        while len(self._noise) < 2 * size:
            self._noise = torch.cat([self._noise, self._noise.flip(0)])
        start = self.rng.integers(0, len(self._noise) - size)
        return self._noise[start : start + size]

    def _add_noise(self, image: Tensor) -> None:
        """Add Gaussian noise to (B, 3, H, W), in place."""
        count = len(image)
        noise = self.rng.gamma(1.2, 0.014, count).clip(0, 0.08)
        # Photon noise grows with the root of the light; the rest is sensor noise.
        photon = self.rng.random(count) < 0.5
        for one, level, grows in zip(image, noise, photon, strict=True):
            grain = self.grain(one.numel()).view(one.shape)
            if grows:
                one.addcmul_(grain, one.clamp(0, 1).sqrt_(), value=1.5 * level)
            else:
                one.add_(grain, alpha=level)

    def _column(self, values: NDArray[np.generic]) -> Tensor:
        return torch.from_numpy(np.asarray(values, np.float32)).view(-1, 1, 1, 1)

    def _some(self, share: float, image: Tensor) -> Tensor:
        return torch.from_numpy(np.nonzero(self.rng.random(len(image)) < share)[0])

    def _uniform(self, low: float, high: float, count: int) -> Tensor:
        return torch.from_numpy(self.rng.uniform(low, high, count).astype(np.float32))

    def apply(self, image: Tensor, light: Float32Array | None = None, lit: BoolArray | None = None) -> Tensor:
        """Apply random faults, except for compression.

        Args:
            image: (B, 3, H, W) in 0..1.
            light: (B, 3) factors on red, green and blue, applied after the exposure: below one, images are darker than
                a camera would expose them, with the usual noise.
            lit: (B,) images whose exposure is already right.

        Returns:
            The same shape, not clamped.
        """
        rng, count = self.rng, len(image)
        # Cameras adjust their exposure: hardly any image is dark all over.
        level = image.mean((1, 2, 3), keepdim=True)
        wanted = self._column(rng.uniform(0.12, 0.3, count))
        gain = (wanted / level.clamp(min=1e-3)).clamp(1.0, 5.0)
        if lit is not None:
            gain[torch.from_numpy(lit)] = 1.0
        image = image * gain
        self._blur(image)
        for i in np.nonzero(rng.random(count) < 0.35)[0]:
            image[i] = other_hue(image[i], rng.uniform(-0.25, 0.25))
        image = self._colour(image).clamp_(1e-4, 1).pow_(self._column(np.exp(rng.normal(0, 0.25, count))))
        if light is not None:
            image *= torch.from_numpy(light)[:, :, None, None]
        self._lens_and_shutter(image)
        self._add_noise(image)
        some = self._some(0.2, image)
        if len(some):  # sharpening
            soft = _gaussian_blur(image[some], 5, np.ones(len(some)))
            image[some] += (image[some] - soft) * self._uniform(0.3, 1.5, len(some)).view(-1, 1, 1, 1)
        return image

    def _blur(self, image: Tensor) -> None:
        """Defocus, motion blur and low resolution for some of (B, 3, H, W), in place."""
        rng = self.rng
        some = self._some(0.45, image)
        if len(some):
            sigma = rng.uniform(0.3, 1.6, len(some)) * (min(image.shape[-2:]) / 192)
            image[some] = _gaussian_blur(image[some], 7, sigma)
        some = self._some(0.15, image)
        if len(some):
            angle = self._uniform(0, 180, len(some))
            length = int(rng.choice([3, 5, 7, 9]))
            image[some] = kornia.filters.motion_blur(image[some], length, angle, torch.zeros(len(some)))
        some = self._some(0.15, image)
        if len(some):
            share = rng.uniform(0.3, 0.8)
            small = [int(n * share) for n in image.shape[-2:]]
            low = torch.nn.functional.interpolate(image[some], small, mode="area")
            image[some] = torch.nn.functional.interpolate(low, image.shape[-2:], mode="bilinear")

    def _colour(self, image: Tensor) -> Tensor:
        """Saturation, brightness, contrast, white balance and black level of (B, 3, H, W): one affine colour map per
        image."""
        rng, (count, channels, height, width) = self.rng, image.shape
        saturation = np.exp(rng.normal(0, 0.35, count)) * (rng.random(count) > 0.1)
        brightness = np.exp(rng.normal(0, 0.12, count))
        balance = np.exp(rng.normal(0, 0.06, (count, 3)))
        contrast = np.exp(rng.normal(0, 0.22, count))
        level = brightness * image.mean((1, 2, 3)).numpy()  # which saturation does not change
        offset = balance * (level * (1 - contrast))[:, None] + rng.normal(0, 0.05, count)[:, None]
        s = saturation[:, None, None]
        matrix = (s * np.eye(3) + (1 - s) / 3) * (brightness * contrast)[:, None, None] * balance[:, :, None]
        matrix_t, offset_t = torch.from_numpy(matrix.astype(np.float32)), torch.from_numpy(offset.astype(np.float32))
        flat = image.reshape(count, channels, -1)
        return torch.baddbmm(offset_t[:, :, None], matrix_t, flat).view(count, channels, height, width)

    def _lens_and_shutter(self, image: Tensor) -> None:
        """Vignetting for some of (B, 3, H, W), and flicker bands of lamps under a rolling shutter; in place."""
        rng, (height, width), count = self.rng, image.shape[-2:], len(image)
        y, x = torch.linspace(-1, 1, height)[:, None], torch.linspace(-1, 1, width)
        corner, to_side = rng.uniform(0, 0.35, count), rng.normal(0, 0.4, count)
        for i in np.nonzero(rng.random(count) < 0.25)[0]:
            image[i] *= 1 - corner[i] * ((x - to_side[i]) ** 2 + y**2)
        band, waves = rng.uniform(0, 0.2, count), rng.uniform(2, 12, count)
        for i in np.nonzero(rng.random(count) < 0.08)[0]:
            image[i] *= 1 + band[i] * torch.sin(waves[i] * y + 1.0)  # varies over rows only

    def resample(self, pixels: Tensor, far: float, crisp: float) -> None:
        """Show people of (B, 3, H, W) uint8 crops as small in the picture, and sharpened in a large one; in place.

        Args:
            pixels: the crops.
            far: share of people of 40 to 150 px, enlarged to the crop as in use, with what compression left of them.
            crisp: share of pictures sharpened by the camera, then made smaller.
        """
        if not far and not crisp:
            return
        chance = self.rng.random(len(pixels))
        for i in np.flatnonzero(chance < far + crisp):
            picture = np.ascontiguousarray(pixels[i].numpy().transpose(1, 2, 0))
            small = self._far(picture) if chance[i] < far else self._crisp(picture)
            pixels[i] = torch.from_numpy(np.ascontiguousarray(small.transpose(2, 0, 1)))

    def _far(self, picture: ByteArray) -> ByteArray:
        """(S, S, 3) from a picture in which the person is small: four fifths of the crop."""
        rng, side = self.rng, picture.shape[0]
        wanted = np.exp(rng.uniform(np.log(40), np.log(150))) / 0.8
        low = max(8, round(min(1.0, wanted / side) * side))
        small = np.asarray(cv2.resize(picture, (low, low), interpolation=cv2.INTER_AREA), np.uint8)
        if rng.random() < 0.5:  # sharpened by the camera
            small = _sharpened(small, float(rng.uniform(0.3, 1.2)), 0.8)
        noise = self.grain(small.size).numpy().reshape(small.shape) * min(14.0, float(rng.gamma(1.2, 3.0)))
        small = (small + noise).clip(0, 255).astype(np.uint8)
        if rng.random() < 0.7:
            small = through_jpeg(small, int(rng.uniform(25, 95)))
        return np.asarray(cv2.resize(small, (side, side), interpolation=cv2.INTER_LINEAR), np.uint8)

    def _crisp(self, picture: ByteArray) -> ByteArray:
        return _sharpened(picture, float(self.rng.uniform(0.8, 2.5)), float(self.rng.uniform(0.6, 1.3)))

    def compress(self, pixels: Tensor, on_film: Collection[int] = ()) -> Tensor:
        """Bayer mosaic, H.264 and JPEG for some of (B, 3, H, W) uint8, in place; no mosaic for those `on_film`, whose
        fine detail it would colour."""
        bayer, codec = self.rng.random(len(pixels)) < 0.1, self.rng.random(len(pixels))
        bayer[list(on_film)] = False
        for i in np.nonzero(bayer | (codec < 0.35))[0]:
            picture = np.ascontiguousarray(pixels[i].numpy().transpose(1, 2, 0))
            picture = through_bayer(picture) if bayer[i] else picture
            if codec[i] < 0.03 and not (picture.shape[0] % 2 or picture.shape[1] % 2):
                picture = through_h264(picture, int(self.rng.uniform(24, 42)))
            elif codec[i] < 0.35:
                picture = through_jpeg(picture, int(self.rng.uniform(15, 85)))
            pixels[i] = torch.from_numpy(picture.transpose(2, 0, 1).copy())
        return pixels


def _gaussian_blur(image: Tensor, window: int, sigma: FloatArray) -> Tensor:
    """(B, 3, H, W) filtered with a Gaussian of `sigma` (B,) px, `window` px wide; several times as fast as a
    convolution."""
    planes = np.ascontiguousarray(image.numpy())
    out = np.empty(planes.shape, np.float32)
    for source, target, width in zip(planes, out, sigma, strict=True):
        for k in range(3):
            cv2.GaussianBlur(source[k], (window, window), width, dst=target[k], borderType=cv2.BORDER_REFLECT_101)
    return torch.from_numpy(out)


def other_hue(image: Tensor, turn: float) -> Tensor:
    """(3, H, W), clamped to 0..1, with the hue rotated by `turn` radians; many times as fast as with kornia."""
    picture = cv2.cvtColor(np.ascontiguousarray(image.clamp(0, 1).numpy().transpose(1, 2, 0)), cv2.COLOR_RGB2HSV)
    picture[..., 0] = (picture[..., 0] + np.degrees(turn)) % 360
    return torch.from_numpy(np.ascontiguousarray(cv2.cvtColor(picture, cv2.COLOR_HSV2RGB).transpose(2, 0, 1)))


def through_bayer(picture: ByteArray) -> ByteArray:
    """(H, W, 3) sampled through a Bayer filter and interpolated again."""
    mosaic = picture[..., 1].copy()
    mosaic[0::2, 0::2] = picture[0::2, 0::2, 0]
    mosaic[1::2, 1::2] = picture[1::2, 1::2, 2]
    return np.asarray(cv2.cvtColor(mosaic, cv2.COLOR_BayerBG2RGB), np.uint8)


def _sharpened(picture: ByteArray, strength: float, sigma: float) -> ByteArray:
    """(H, W, 3) with its edges exaggerated, with halos, as phones do."""
    soft = cv2.GaussianBlur(picture, (0, 0), sigma)
    return np.asarray(cv2.addWeighted(picture, 1 + strength, soft, -strength, 0), np.uint8)


def through_jpeg(picture: ByteArray, quality: int) -> ByteArray:
    """(H, W, 3) compressed with this quality, 0 to 100."""
    _, code = cv2.imencode(".jpg", picture, [cv2.IMWRITE_JPEG_QUALITY, quality])
    return np.asarray(cv2.imdecode(code, cv2.IMREAD_COLOR), np.uint8)


def through_h264(picture: ByteArray, quantiser: int) -> ByteArray:
    """(H, W, 3), of even sides, encoded as one H.264 intra frame with this quantiser (0..51, higher is worse)."""
    encoder = av.CodecContext.create("libx264", "w")
    encoder.height, encoder.width = picture.shape[:2]
    encoder.pix_fmt, encoder.time_base = "yuv420p", Fraction(1, 30)
    encoder.options = {"qp": str(quantiser), "preset": "superfast", "tune": "zerolatency", "threads": "1"}
    frame = av.VideoFrame.from_ndarray(picture, format="rgb24")
    packets = [*encoder.encode(frame), *encoder.encode(None)]
    decoder = av.CodecContext.create("h264", "r")
    frames = [f for packet in packets for f in decoder.decode(packet)] + list(decoder.decode(None))
    return np.asarray(frames[0].to_ndarray(format="rgb24"), np.uint8)


def outside_of_video(rng: np.random.Generator, height: int, width: int) -> tuple[BoolArray, tuple[float, float, float]]:
    """The area beyond the border of a video, black in a crop that extends over it; slanted where the image of a rolled
    camera was rotated upright.

    Returns:
        Mask (height, width), and (nx, ny, edge): a point p, relative to the image centre, is outside if nx * px + ny *
            py > edge.
    """
    slant = rng.normal(0, 0.25) if rng.random() < 0.7 else 0.0
    turns = int(rng.integers(4))
    angle = slant + turns * np.pi / 2
    edge = (height if turns % 2 else width) * (0.5 - 0.5 * rng.beta(1.0, 3.0))
    nx, ny = float(np.cos(angle)), float(np.sin(angle))
    y, x = np.mgrid[:height, :width].astype(np.float32)
    mask = (x - (width - 1) / 2) * nx + (y - (height - 1) / 2) * ny > edge
    return mask, (nx, ny, float(edge))
