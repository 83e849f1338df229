"""Devices of networks. No graphics card is needed: which providers are asked for, and what is said without them."""

import numpy as np
import pytest

from muybridge.errors import ModelError
from muybridge.infer.commands.app import run_command
from muybridge.infer.networks.sessions import PROVIDERS, open_session, providers
from muybridge.models.shipped import shipped_model

CPU = "CPUExecutionProvider"


def test_the_processor_is_asked_for_alone():
    assert providers("cpu", [*PROVIDERS.values(), CPU]) == [CPU]


@pytest.mark.parametrize("device", PROVIDERS)
def test_a_card_comes_before_the_processor(device):
    assert providers(device, [CPU, PROVIDERS[device]]) == [PROVIDERS[device], CPU]
    assert providers("auto", [CPU, PROVIDERS[device]]) == [PROVIDERS[device], CPU]


def test_auto_takes_the_first_card_and_else_the_processor():
    assert providers("auto", list(reversed(PROVIDERS.values()))) == [PROVIDERS["cuda"], CPU]
    assert providers("auto", [CPU, "AzureExecutionProvider"]) == [CPU]


def test_a_device_that_is_not_there_names_its_package():
    with pytest.raises(ModelError, match="device cuda.*CUDAExecutionProvider.*onnxruntime-gpu"):
        providers("cuda", [CPU])


def test_a_provider_that_cannot_start_is_said(monkeypatch):
    # onnxruntime says that the provider is there, and then goes on without it.
    monkeypatch.setattr("onnxruntime.get_available_providers", lambda: [PROVIDERS["cuda"], CPU])
    with pytest.raises(ModelError, match="could not start CUDAExecutionProvider"):
        open_session(shipped_model("people", "fp32"), device="cuda")
    session = open_session(shipped_model("people", "fp32"), device="auto")
    assert session.get_providers() == [CPU]
    assert session.run(None, {"image": np.zeros((1, 4, 64, 64), np.float32)})[0].shape[0] == 1


def test_a_run_on_a_device_that_is_not_there_writes_nothing(make_session, tmp_path, capsys):
    out = tmp_path / "results"
    assert run_command(["run", str(make_session(frames=4)), "--out", str(out), "--device", "cuda"]) == 2
    assert "onnxruntime-gpu" in capsys.readouterr().err
    assert not (out / "points.trc").exists()
