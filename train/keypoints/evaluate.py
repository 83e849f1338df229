"""Scores of an exported keypoint network on held-out synthetic people, decoded as in use."""

import pathlib
from dataclasses import replace

import numpy as np
import onnxruntime
from rich.progress import track

from muybridge.arrays import BoolArray, Float32Array, FloatArray
from muybridge.errors import ModelError, SessionError
from muybridge.geometry.landmarks.sets import BODY23
from muybridge.models.keypoints.decode import DecodedHeatmaps
from muybridge.models.keypoints.metadata import BODY_OUTPUTS, KeypointModelCard, keypoint_card
from muybridge.models.keypoints.test_time import augment_at_test_time, mean_of_mirrored
from muybridge.models.metadata_reader import metadata_of
from muybridge.models.shipped import shipped_model
from muybridge.train.images.backgrounds import make_backgrounds
from muybridge.train.images.compositor import Batch, Compositor
from muybridge.train.images.dataset import HELD_OUT
from muybridge.train.images.options import WHOLE
from muybridge.train.keypoints.options import Evaluation
from muybridge.train.synthesis.rendering.framing import SIZE
from muybridge.train.synthesis.rendering.store import load_renders

MIRROR = np.array(BODY23.mirror)
# All landmarks but nose, eyes and ears.
LIMB = np.arange(len(MIRROR)) >= 5


def load_model(path: pathlib.Path) -> tuple[onnxruntime.InferenceSession, KeypointModelCard]:
    """A keypoint network and its card; ModelError if the file is not a muybridge keypoint network."""
    options = onnxruntime.SessionOptions()
    options.log_severity_level = 3  # the optional input is intended
    if not path.is_file():
        raise ModelError(f"{path}: no such model file")
    try:
        session = onnxruntime.InferenceSession(str(path), options, providers=["CPUExecutionProvider"])
    except Exception as error:  # onnxruntime's exceptions share no base class but Exception
        raise ModelError(f"{path}: not an ONNX model, or a damaged one ({str(error).splitlines()[0]})") from error
    return session, keypoint_card(metadata_of(session, path), path)


def read_crops(
    session: onnxruntime.InferenceSession, card: KeypointModelCard, image: Float32Array, flip: bool, turn: bool
) -> DecodedHeatmaps:
    """Body landmarks in crops, with the test-time augmentation of `muybridge run`.

    Args:
        session, card: the network.
        image: (N, C, S, S), 0 to 1.
        flip: average with the mirrored crops.
        turn: rotate uncertain crops; with `flip`, also tilt them.
    """

    def read_once(image: Float32Array) -> list[Float32Array]:
        found: list[Float32Array] = session.run(BODY_OUTPUTS, card.inputs(np.ascontiguousarray(image)))
        return found

    def read(image: Float32Array) -> list[Float32Array]:
        if not flip:
            return read_once(image)
        return [
            mean_of_mirrored(a, b, MIRROR) for a, b in zip(read_once(image), read_once(image[..., ::-1]), strict=True)
        ]

    maps = read(image)
    found = augment_at_test_time(read, image, maps, card, rows=2, tilt=flip) if turn else card.decode(maps[0])
    return card.scale_variance(found, maps[1], flip)


def read_batch(
    session: onnxruntime.InferenceSession, card: KeypointModelCard, batch: Batch, flip: bool, turn: bool
) -> tuple[DecodedHeatmaps, FloatArray, BoolArray]:
    """Body landmarks in a batch's crops.

    Args:
        session, card, flip, turn: as in `read_crops`.
        batch: of crops.

    Returns:
        The landmarks, their errors (N, J, 2) px, and which of them (N, J) lie inside the crop.
    """
    crops, truth = batch.pixels.numpy().astype(np.float32) / np.float32(255), batch.landmarks_px.numpy()
    found = read_crops(session, card, crops, flip, turn)
    return found, found.points_crop_px - truth, ((truth >= 0) & (truth < crops.shape[-1])).all(axis=-1)


def evaluate_onnx(options: Evaluation) -> dict[str, float]:
    """Scores of visible landmarks, calibration of the variance also for all landmarks inside the crop; pixels are those
    of the network."""
    path = options.model or shipped_model("keypoints")
    session, card = load_model(path)
    store = load_renders(options.renders, None if options.all_shards else HELD_OUT)
    if not len(store):
        raise SessionError(f"{options.renders}: no held-out renders; make some with `muybridge synth`")
    # Other backgrounds than any training's pool.
    backgrounds = make_backgrounds(256, SIZE, options.seed)
    asked = {name: float(getattr(options, name)) for name in ("plate", "backdrop", "tinted", "monochrome")}
    augment = replace(WHOLE, **asked, faults=options.faults)
    if not options.occlusion:
        augment = replace(augment, second_person=0, occluder=0, mosaic=0, truncate=0, tumble=0, clutter=0)
    if options.embrace:
        augment = replace(augment, second_person=0, embrace=1)
    compositor = Compositor(store, backgrounds, card.input_size, options.seed, augment)

    distances, twins, inside_sigma, visibles, insides = [], [], [], [], []
    for begin in track(range(0, options.crops, 64), "scoring", transient=True):
        batch = compositor.batch(min(64, options.crops - begin))
        decoded, error, inside = read_batch(session, card, batch, options.flip, options.turn)
        distances.append(np.linalg.norm(error, axis=-1))
        twins.append(np.linalg.norm(decoded.points_crop_px - batch.landmarks_px.numpy()[:, MIRROR], axis=-1))
        inside_sigma.append(np.abs(error) / np.sqrt(decoded.variance_crop_px2)[..., None])
        visibles.append(batch.visible.numpy())
        insides.append(inside)
    return _figures(
        np.concatenate(distances), np.concatenate(twins), np.concatenate(inside_sigma), np.concatenate(visibles),
        np.concatenate(insides), card.input_size,
    )  # fmt: skip


def _figures(
    distance: FloatArray, twin: FloatArray, in_sigma: FloatArray,
    visible: BoolArray, inside: BoolArray, size: int,
) -> dict[str, float]:  # fmt: skip
    # Twins at one place are indistinguishable. Eyes and ears are so close together that the share over all landmarks
    # looks better than that over the limbs.
    flipped = (twin < distance) & visible & (MIRROR != np.arange(len(MIRROR))) & (np.abs(twin - distance) > 0.03 * size)
    limb = np.broadcast_to(LIMB, visible.shape)
    box = size / 1.25
    near = (distance < 0.05 * box) & visible
    return {
        "median error px": float(np.median(distance[visible])),
        "mean error px": float(distance[visible].mean()),
        "PCK@0.05 of the box": float(near.sum() / visible.sum()),
        "PCK@0.05, standard error": _standard_error(near, visible),
        "PCK@0.1 of the box": float((distance[visible] < 0.1 * box).mean()),
        "left-right flips": float(flipped[limb].sum() / visible[limb].sum()),
        "left-right flips, with face": float(flipped.sum() / visible.sum()),
        "flips, standard error": _standard_error(flipped, visible),
        "within 1 sigma (0.683)": float((in_sigma[inside] < 1).mean()),
        "within 2 sigma (0.954)": float((in_sigma[inside] < 2).mean()),
        "within 1 sigma, visible": float((in_sigma[visible] < 1).mean()),
        "within 2 sigma, visible": float((in_sigma[visible] < 2).mean()),
    }


def _standard_error(counted: BoolArray, all_: BoolArray) -> float:
    """Standard error of the share of `counted` in `all_`, (N, J), when crops are the sampling unit, not landmarks: half
    of the flips lie in a few crops. Linearised ratio estimator, Cochran, "Sampling Techniques", 1977, eq. 2.45."""
    each, total = counted.sum(1), all_.sum(1)
    residual = each - each.sum() / max(total.sum(), 1) * total
    count = len(each)
    return float(np.sqrt((residual**2).sum() * count / max(count - 1, 1)) / max(total.sum(), 1))
