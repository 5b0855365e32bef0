"""The reference names what the program and the package have; shells and man can read completions and man pages."""

import re
import shutil
import sys
import tomllib
from pathlib import Path

import pytest
from programs import ROOT, program, ran


def output_of(*words: object) -> str:
    return ran(*words).stdout


def test_every_table_is_in_the_reference() -> None:
    text = output_of(program("graspmill"), "manual", "markdown", "tables")
    assert re.findall("^## (.*)", text, re.MULTILINE) == ["attempts", "scenes", "objects"] and text.count("\n| `") > 50


def keys_of(value: object, prefix: str = "") -> set[str]:
    """The keys of a settings file; ``[]`` stands for each table of a list."""
    if isinstance(value, dict):
        return {key for name, inner in value.items() for key in keys_of(inner, f"{prefix}.{name}" if prefix else name)}
    if isinstance(value, list) and value and isinstance(value[0], dict):
        return {key for inner in value for key in keys_of(inner, f"{prefix}[]")}
    return {prefix}


@pytest.mark.parametrize("folder", ["generate", "grippers", "train", "plan", "experiment"])
def test_every_key_of_the_shipped_settings_is_in_the_reference(folder: str) -> None:
    parts = output_of(program("graspmill"), "manual", "markdown", "settings").split("\n## ")
    text = "".join(part for part in parts if part.startswith(f"configs/{folder}/"))
    assert text, folder
    for path in sorted((ROOT / "configs" / folder).glob("*.toml")):
        missing = [key for key in sorted(keys_of(tomllib.loads(path.read_text()))) if f"| `{key}` |" not in text]
        assert not missing, path.name


def test_the_page_of_the_python_package_has_every_name() -> None:
    names = pytest.importorskip("graspmill").__all__
    text = output_of(sys.executable, ROOT / "scripts/python_reference.py")
    assert not [name for name in names if f"\n### {name}\n\n`" not in text]


@pytest.mark.parametrize("shell", ["bash", "zsh", "fish"])
def test_completions_are_read_by_their_shell(shell: str, tmp_path: Path) -> None:
    script = tmp_path / f"graspmill.{shell}"
    script.write_text(output_of(program("graspmill"), "manual", "completions", shell))
    assert "graspmill" in script.read_text()
    if shutil.which(shell) is None:
        pytest.skip(f"no {shell} here")
    output_of(shell, "-n", script)


def test_bash_completes_a_command_and_a_flag(tmp_path: Path) -> None:
    script = tmp_path / "graspmill.bash"
    script.write_text(output_of(program("graspmill"), "manual", "completions", "bash"))
    ask = f"""
        source {script}
        COMP_WORDS=(graspmill dataset rep); COMP_CWORD=2; _graspmill graspmill rep dataset; echo "${{COMPREPLY[@]}}"
        COMP_WORDS=(graspmill dataset report --ht); COMP_CWORD=3; _graspmill graspmill --ht report; echo "${{COMPREPLY[@]}}"
    """
    assert output_of("bash", "-c", ask).split() == ["report", "replay", "repeat", "--html"]


def test_man_pages_and_the_reference_have_every_command(tmp_path: Path) -> None:
    output_of(program("graspmill"), "manual", "man", str(tmp_path))
    pages = {page.name for page in tmp_path.iterdir()}
    headings = re.findall("^## (.*)", output_of(program("graspmill"), "manual", "markdown", "commands"), re.MULTILINE)
    assert pages == {f"{heading.replace(' ', '-')}.1" for heading in headings}
    assert pages >= {"graspmill.1", "graspmill-generate.1", "graspmill-dataset-report.1", "graspmill-plan.1", "graspmill-experiment-run.1"}
    for words in ([], ["dataset"], ["experiment"], ["objects"]):
        listed = re.search(r"Commands:\n((?:  .*\n)+)", output_of(program("graspmill"), *words, "--help"))[1]
        commands = re.findall(r"^  ([a-z-]+) ", listed, re.MULTILINE)
        name = "-".join(["graspmill", *words])
        assert len(commands) >= 3 and all(f"{name}-{command}.1" in pages for command in commands if command != "help"), name
    for page in tmp_path.iterdir():
        text = page.read_text()
        assert text.count(".SH NAME") == 1 and ".TH" in text, page.name
