"""Log of a run."""

from train.run.logbook import over_held_out


def test_validation_reports_progress(capsys):
    assert list(over_held_out(["a", "b", "c"])) == ["a", "b", "c"]
    message = capsys.readouterr().err
    assert "validating" in message
    assert "0/3" in message
