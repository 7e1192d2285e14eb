"""``bokehnet synth`` from the command line."""

from bokehnet.cli.app import run
from bokehnet.synth.shards import ShardSet

SMALL = ["--set", "scenes=1", "--set", "width=24", "--set", "height=16", "--set", "bokeh_samples=1"]


def test_values_of_the_configuration_are_replaced(tmp_path, capsys):
    assert run(["synth", "--config", "configs/synth_tiny.toml", "--out", str(tmp_path / "set"), *SMALL]) == 0
    assert capsys.readouterr() == (
        f"wrote {tmp_path / 'set'}: 1 scenes in 1 shards\n",
        "bokehnet: rendering scenes: 0 of 1\n",
    )
    result = ShardSet(tmp_path / "set")
    assert len(result) == 1
    assert result[0].image.shape == (16, 24, 3)


def test_a_value_that_cannot_be_replaced_is_one_line_and_nothing_is_written(tmp_path, capsys):
    for setting, words in (("scenes", "--set: expected key=value"), ("scenery=3", "scenery")):
        out = tmp_path / "set"
        command = ["synth", "--config", "configs/synth_tiny.toml", "--out", str(out), "--set", setting]
        assert run(command) == 1
        message = capsys.readouterr().err
        assert words in message
        assert len(message.strip().splitlines()) == 1
        assert not out.exists()
