"""Completion in shells. Authority: the shells themselves, where they are installed."""

import os
import shutil
import subprocess
import sys

import pytest


@pytest.fixture
def shell(tmp_path):
    """Run a script in a shell that finds the program ``bokehnet``; return the words that it prints."""
    program = tmp_path / "bin" / "bokehnet"
    program.parent.mkdir()
    source = "from bokehnet.cli.app import main; main()"
    program.write_text(f'#!/bin/sh\nexec "{sys.executable}" -c "{source}" "$@"\n')
    program.chmod(0o755)
    environment = {
        **os.environ,
        "PATH": f"{program.parent}{os.pathsep}{os.environ['PATH']}",
        "PYTHONPATH": os.pathsep.join(sys.path),
        "HOME": str(tmp_path),
    }

    def call(name, script):
        if shutil.which(name) is None:
            pytest.skip(f"needs {name}")
        done = subprocess.run(
            [name, "-c", script], env=environment, cwd=tmp_path, capture_output=True, text=True, timeout=60
        )
        assert done.returncode == 0, done.stderr
        return [line.split("\t")[0] for line in done.stdout.splitlines()]

    return call


CASES = [
    (["render", "--bl"], {"--blur", "--blades", "--blade-curvature"}),
    (["render", "--engine", ""], {"rays", "scatter", "hybrid"}),
    (["render", "--preset", "pet"], {"petzval-swirl"}),
    (["render", "--help", "ap"], {"aperture"}),
    (["pre"], {"presets"}),
    (["lens", "re"], {"report"}),
]


@pytest.mark.slow
@pytest.mark.parametrize(("words", "expected"), CASES)
def test_bash_completes(shell, words, expected):
    line = " ".join(f"'{word}'" for word in ("bokehnet", *words))
    script = (
        "compopt() { :; }; source <(bokehnet --show-completion bash)\n"
        f"COMP_WORDS=({line}); COMP_CWORD={len(words)}; _bokehnet_completion bokehnet\n"
        'printf "%s\\n" "${COMPREPLY[@]}"'
    )
    assert expected <= set(shell("bash", script))


@pytest.mark.slow
@pytest.mark.parametrize(("words", "expected"), CASES)
def test_fish_completes(shell, words, expected):
    line = " ".join(("bokehnet", *words))
    script = f'bokehnet --show-completion fish | source; complete -C "{line}"'
    assert expected <= set(shell("fish", script))


@pytest.mark.slow
def test_zsh_accepts_the_script(shell, tmp_path):
    shell("zsh", "bokehnet --show-completion zsh > script; zsh -n script")
    assert (tmp_path / "script").read_text().startswith("#compdef bokehnet")


@pytest.mark.parametrize("name", ["bash", "zsh", "fish", "powershell"])
def test_every_shell_has_a_script_that_calls_the_program(cli, name):
    outcome = cli("--show-completion", name)
    if name == "powershell" and outcome.code:
        pytest.skip("needs click 8.5")
    assert (outcome.code, outcome.err) == (0, "")
    assert f"{name}_complete" in outcome.out


@pytest.mark.parametrize(
    ("name", "file", "startup"),
    [
        ("bash", ".bash_completions/bokehnet.sh", ".bashrc"),
        ("zsh", ".zfunc/_bokehnet", ".zshrc"),
        ("fish", ".config/fish/completions/bokehnet.fish", None),
    ],
)
def test_installation_adds_one_line_and_keeps_the_rest(cli, tmp_path, monkeypatch, name, file, startup):
    monkeypatch.setenv("HOME", str(tmp_path))
    monkeypatch.setenv("SHELL", f"/usr/bin/{name}")
    if startup:
        (tmp_path / startup).write_text("own line")
    for _ in range(2):
        outcome = cli("--install-completion")
        assert (outcome.code, outcome.err) == (0, "")
        assert (tmp_path / file).read_text() == cli("--show-completion", name).out.rstrip("\n") + "\n"
    if startup:
        lines = (tmp_path / startup).read_text().splitlines()
        assert (lines[0], len(lines)) == ("own line", 2)


@pytest.mark.parametrize("flag", ["--show-completion", "--install-completion"])
def test_an_unknown_shell_is_refused(cli, flag):
    outcome = cli(flag, "tcsh")
    assert outcome.code == 1
    assert f"{flag}: expected one of bash, zsh, fish, powershell, got 'tcsh'" in outcome.err
