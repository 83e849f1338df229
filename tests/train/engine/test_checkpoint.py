"""Checkpoints hold data only, and reading one never runs code."""

import ast
import pathlib
import pickle
import zipfile
from typing import Any

import pytest

torch = pytest.importorskip("torch")

from muybridge.errors import ModelError, SessionError  # noqa: E402
from muybridge.models.keypoints.network import KeypointNet  # noqa: E402
from muybridge.models.labelling.network import LabelNet  # noqa: E402
from muybridge.models.people.network import PeopleNet  # noqa: E402
from muybridge.train.engine.checkpoint import CHECKPOINT, load_checkpoint, save_checkpoint  # noqa: E402
from muybridge.train.engine.loop import TrainingRun  # noqa: E402
from muybridge.train.engine.options import Training  # noqa: E402
from muybridge.train.keypoints.export import load_keypoint_checkpoint  # noqa: E402
from tests.paths import REPOSITORY, tracked_files  # noqa: E402


class Attack:
    """Creates a file when it is unpickled."""

    def __init__(self, proof: pathlib.Path) -> None:
        self.proof = proof

    def __reduce__(self) -> tuple[Any, ...]:
        return pathlib.Path.touch, (self.proof,)


def plain(net: torch.nn.Module) -> dict[str, Any]:
    return {"average": net.state_dict(), "config": net.config, "state": {"images": 3, "seconds": 1.5}}


def refuses(path: pathlib.Path, proof: pathlib.Path) -> None:
    for load in (load_checkpoint, load_keypoint_checkpoint):
        with pytest.raises(ModelError, match="could run code") as caught:
            load(path)
        assert "\n" not in str(caught.value) and str(path) in str(caught.value)
    assert not proof.exists()


@pytest.mark.parametrize("place", ["state", "config", "optimiser"])
def test_a_checkpoint_with_code_in_it_is_refused(tmp_path: pathlib.Path, place: str) -> None:
    path, proof = tmp_path / CHECKPOINT, tmp_path / "proof"
    torch.save(plain(KeypointNet(23)) | {place: {"images": Attack(proof)}}, path)
    assert zipfile.is_zipfile(path)
    refuses(path, proof)
    torch.load(path, weights_only=False)  # the attack works where objects are unpickled
    assert proof.exists()


def test_a_pickle_with_code_in_it_is_refused(tmp_path: pathlib.Path) -> None:
    path, proof = tmp_path / CHECKPOINT, tmp_path / "proof"
    path.write_bytes(pickle.dumps(Attack(proof)))
    refuses(path, proof)


def test_a_run_does_not_resume_from_a_checkpoint_with_code_in_it(tmp_path: pathlib.Path) -> None:
    proof, net = tmp_path / "proof", KeypointNet(23)
    torch.save(plain(net) | {"net": net.state_dict(), "optimiser": Attack(proof)}, tmp_path / CHECKPOINT)
    with pytest.raises(SessionError, match="could run code"):
        TrainingRun(Training(out=tmp_path), net, lambda net: {})
    assert not proof.exists()


def test_other_files_are_refused(tmp_path: pathlib.Path) -> None:
    path = tmp_path / CHECKPOINT
    with pytest.raises(ModelError, match="no such checkpoint"):
        load_checkpoint(path)
    path.write_bytes(b"nothing")
    with pytest.raises(ModelError, match="not a training checkpoint"):
        load_checkpoint(path)
    save_checkpoint(path, {"state": {}})
    with pytest.raises(ModelError, match="no average, config in it"):
        load_checkpoint(path)


@pytest.mark.parametrize("kind", [KeypointNet, PeopleNet, LabelNet])
def test_a_run_resumes_where_it_was(tmp_path: pathlib.Path, kind: type[torch.nn.Module]) -> None:
    """Weights, averaged weights, both optimisers and counters survive the file."""

    def score(net: torch.nn.Module) -> dict[str, float]:
        return {"figure": 0.5}

    torch.manual_seed(0)
    run = TrainingRun(Training(out=tmp_path), kind(), score)
    for parameter in run.net.parameters():
        parameter.grad = torch.randn_like(parameter)
    run.optimiser.step()
    run.average.update(run.net, 0)
    run.state |= {"step": 1, "images": 8, "seconds": 2.5}
    run._save([1.0], lambda images: 4.0)
    again = TrainingRun(Training(out=tmp_path), kind(), score)
    assert again.state == run.state and load_checkpoint(run.checkpoint)["scores"] == {"figure": 0.5}
    for ours, theirs in ((again.net.state_dict(), run.net.state_dict()), (again.average.state, run.average.state)):
        assert ours.keys() == theirs.keys() and all(torch.equal(ours[key], theirs[key]) for key in ours)
    for ours, theirs in zip(again.optimiser.parts, run.optimiser.parts, strict=True):
        before, after = theirs.state_dict()["state"], ours.state_dict()["state"]
        assert before.keys() == after.keys() and before
        assert all(torch.equal(after[k][name], before[k][name]) for k in before for name in before[k])


def test_nothing_unpickles_objects() -> None:
    loads = 0
    for path in tracked_files():
        if path.suffix != ".py" or path.is_relative_to(REPOSITORY / "tests"):
            continue
        for call in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if not isinstance(call, ast.Call):
                continue
            given = {k.arg: ast.unparse(k.value) for k in call.keywords}
            called = ast.unparse(call.func)
            if called == "torch.load":
                loads += 1
                assert given.get("weights_only") == "True", f"{path}:{call.lineno}"
            assert called not in ("pickle.load", "pickle.loads") and given.get("allow_pickle") != "True", path
    assert loads
