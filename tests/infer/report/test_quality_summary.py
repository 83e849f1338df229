"""What a run says about itself in words."""


def test_of_two_cameras_none_can_be_left_out(make_session, staged, tmp_path):
    pair = make_session(["cam1", "cam2"], frames=12, width=160, height=120)
    done = staged("run", pair, "--out", tmp_path / "results", "--quiet")
    assert done.returncode == 0, done.stderr
    assert "no camera can be left out" in done.stdout and "nan" not in done.stdout
    assert "NaN" not in (tmp_path / "results" / "run.json").read_text()
