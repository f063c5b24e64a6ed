"""The commit of the current folder is read, and no program of its repository ever runs."""

import os
import shutil
import subprocess
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from contactlab.run.evidence_record import find_provenance
from contactlab.run.git_commit import commit_of

pytestmark = pytest.mark.skipif(shutil.which("git") is None, reason="git is not installed")
Git = Callable[..., str]
SHA1, SHA256 = 40, 64


@pytest.fixture
def git(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Git:
    """Run git in a folder, without the configuration of whoever runs the tests."""
    monkeypatch.setenv("HOME", str(tmp_path))
    monkeypatch.setenv("GIT_CONFIG_NOSYSTEM", "1")
    for role in ("AUTHOR", "COMMITTER"):
        monkeypatch.setenv(f"GIT_{role}_NAME", "a")
        monkeypatch.setenv(f"GIT_{role}_EMAIL", "a@b.c")

    def run(folder: Path, *words: str) -> str:
        command = ["git", "-C", str(folder), *words]
        return subprocess.run(command, check=True, capture_output=True, text=True).stdout.strip()

    return run


@pytest.fixture
def repository(git: Git, tmp_path: Path) -> Path:
    """A repository with one commit of two files, one of them in a folder."""
    folder = tmp_path / "repository"
    (folder / "inner" / "deep").mkdir(parents=True)
    git(folder, "init", "-q", "-b", "main")
    for name in ("data.txt", "inner/deep/more.txt"):
        (folder / name).write_text("1")
    git(folder, "add", ".")
    git(folder, "commit", "-q", "-m", "first")
    return folder


def _is_read_as_git_does(git: Git, folder: Path) -> bool:
    return commit_of(folder) == git(folder, "rev-parse", "HEAD")


def test_a_branch_is_read_from_any_folder(git: Git, repository: Path) -> None:
    assert _is_read_as_git_does(git, repository)
    assert _is_read_as_git_does(git, repository / "inner" / "deep")
    git(repository, "checkout", "-q", "-b", "a/branch/of-its.own")
    git(repository, "commit", "-q", "--allow-empty", "-m", "second")
    assert _is_read_as_git_does(git, repository)


def test_packed_branches_are_read_and_later_ones_win(git: Git, repository: Path) -> None:
    git(repository, "branch", "main-of-old")
    git(repository, "tag", "-a", "v1", "-m", "peeled lines follow it")
    git(repository, "pack-refs", "--all")
    assert not (repository / ".git" / "refs" / "heads" / "main").exists()
    assert _is_read_as_git_does(git, repository)
    git(repository, "commit", "-q", "--allow-empty", "-m", "second")
    assert _is_read_as_git_does(git, repository)


def test_a_detached_head_is_read(git: Git, repository: Path) -> None:
    git(repository, "checkout", "-q", "--detach")
    assert _is_read_as_git_does(git, repository)


@pytest.mark.parametrize("packed", [False, True])
def test_a_linked_worktree_has_a_commit_of_its_own(
    git: Git, repository: Path, tmp_path: Path, packed: bool
) -> None:
    other = tmp_path / "other"
    git(repository, "worktree", "add", "-q", "-b", "topic", str(other))
    git(other, "commit", "-q", "--allow-empty", "-m", "second")
    if packed:
        git(repository, "pack-refs", "--all")
    assert _is_read_as_git_does(git, other)
    assert commit_of(other) != commit_of(repository)


def test_a_submodule_is_read(git: Git, repository: Path, tmp_path: Path) -> None:
    outer = tmp_path / "outer"
    outer.mkdir()
    git(outer, "init", "-q", "-b", "main")
    allow = ("-c", "protocol.file.allow=always")
    git(outer, *allow, "submodule", "--quiet", "add", str(repository), "part")
    git(outer, "commit", "-q", "-m", "with a part")
    assert _is_read_as_git_does(git, outer / "part")
    assert commit_of(outer / "part") != commit_of(outer)


def test_digests_of_64_digits_are_read(git: Git, tmp_path: Path) -> None:
    folder = tmp_path / "long"
    folder.mkdir()
    git(folder, "init", "-q", "--object-format=sha256")
    git(folder, "commit", "-q", "--allow-empty", "-m", "first")
    assert len(commit_of(folder) or "") == SHA256
    assert _is_read_as_git_does(git, folder)


def test_none_without_a_repository_or_a_commit(git: Git, tmp_path: Path) -> None:
    assert commit_of(tmp_path) is None
    git(tmp_path, "init", "-q")
    assert commit_of(tmp_path) is None
    (tmp_path / ".git" / "HEAD").write_text("ref: refs/heads/.invalid\n")  # as reftable has it
    assert commit_of(tmp_path) is None


def test_only_files_of_the_repository_are_read(repository: Path, tmp_path: Path) -> None:
    """A file of the user's with 40 hexadecimal digits may be a token."""
    token = tmp_path / "token"
    token.write_text("0123456789" * 4)
    head, branch = (repository / ".git" / name for name in ("HEAD", "refs/heads/main"))
    own = commit_of(repository)
    branch.unlink()
    branch.symlink_to(token)
    assert commit_of(repository) is None
    shutil.rmtree(branch.parent)
    branch.parent.symlink_to(tmp_path)
    head.write_text("ref: refs/heads/token")
    assert commit_of(repository) is None
    head.write_text("ref: refs/../../../token")
    assert commit_of(repository) is None
    head.unlink()
    head.symlink_to(token)
    assert commit_of(repository) is None
    (repository / ".git" / "packed-refs").symlink_to(token)
    assert commit_of(repository) is None
    head.unlink()
    head.write_text(f"{own}\n")
    assert commit_of(repository) == own


@pytest.mark.parametrize("name", ["HEAD", "refs/heads/main", "packed-refs", "commondir"])
def test_pipes_and_endless_files_end_at_once(repository: Path, name: str) -> None:
    file = repository / ".git" / name
    file.unlink(missing_ok=True)
    os.mkfifo(file)
    commit_of(repository)
    file.unlink()
    file.symlink_to("/dev/zero")
    commit_of(repository)


def _plant(git: Git, folder: Path, marker: Path) -> None:
    """Make git run a program in a folder in every way that a repository can name one."""
    program = folder / "program.sh"
    program.write_text(f"#!/bin/sh\necho ran >>{marker}\ncat\n")
    program.chmod(0o755)
    named = ("core.fsmonitor", "core.pager", "core.editor", "core.sshCommand", "diff.external")
    named += ("filter.x.clean", "filter.x.smudge", "filter.x.process", "diff.x.textconv")
    named += ("pager.describe", "pager.rev-parse", "pager.status", "credential.helper")
    for key in named:
        git(folder, "config", key, str(program))
    for alias in ("describe", "rev-parse", "status"):
        git(folder, "config", f"alias.{alias}", f"!{program}")
    (folder / ".gitattributes").write_text("*.txt filter=x diff=x\n")
    hooks = folder / ".git" / "hooks"
    hooks.mkdir(exist_ok=True)
    for hook in ("post-index-change", "fsmonitor-watchman", "reference-transaction"):
        shutil.copy(program, hooks / hook)
    os.utime(folder / "data.txt", (1, 1))


def _embed_bare(git: Git, folder: Path, program: Path) -> Path:
    """Make a folder of a clone a repository in itself, whose configuration the clone brought."""
    inner = folder / "sweeps"
    shutil.copytree(folder / ".git", inner)
    git(inner, "--git-dir=.", "config", "core.bare", "false")
    git(inner, "--git-dir=.", "config", "core.worktree", ".")
    git(inner, "--git-dir=.", "config", "core.fsmonitor", str(program))
    return inner


@pytest.fixture
def hostile(git: Git, repository: Path, tmp_path: Path) -> Path:
    """A repository that runs a program when git describes it: see that it does."""
    marker = tmp_path / "ran"
    _plant(git, repository, marker)
    command = ["git", "-c", "core.fsmonitor=false", "describe", "--always", "--dirty"]
    subprocess.run(command, cwd=repository, capture_output=True, check=False)
    assert marker.exists(), "the attack does not work with this git, so nothing is tested"
    marker.unlink()
    os.utime(repository / "data.txt", (2, 2))
    return repository


def test_no_program_of_a_repository_runs(
    git: Git, hostile: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    bare = _embed_bare(git, hostile, hostile / "program.sh")
    for folder in (hostile, hostile / "inner", bare):
        monkeypatch.chdir(folder)
        assert len(find_provenance().git_revision or "") == SHA1
    assert not (tmp_path / "ran").exists()


def test_variables_of_git_lead_nowhere_else(
    git: Git, repository: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    other = tmp_path / "other"
    other.mkdir()
    git(other, "init", "-q")
    git(other, "commit", "-q", "--allow-empty", "-m", "another")
    monkeypatch.chdir(repository)
    own = find_provenance().git_revision
    monkeypatch.setenv("GIT_DIR", str(other / ".git"))
    monkeypatch.setenv("GIT_EXTERNAL_DIFF", str(tmp_path / "program"))
    assert find_provenance().git_revision == own


def test_a_removed_folder_has_none(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    gone = tmp_path / "gone"
    gone.mkdir()
    monkeypatch.chdir(gone)
    gone.rmdir()
    assert find_provenance().git_revision is None
    monkeypatch.chdir(tmp_path)


@pytest.mark.long
def test_commands_run_no_program_of_a_repository(
    command: Any, hostile: Path, tmp_path: Path
) -> None:
    """The commands in which the attack was seen, each in its own process."""
    (hostile / "one.yaml").write_text("version: 1\nscene: ball_drop\nduration: 0.01\n")
    command.folder = hostile
    for words in (
        ("sweep", "one.yaml", "-o", "store"),
        ("examine", "ball_drop", "--section", "checks"),
        ("verify", "store", "--simulate", "1"),
    ):
        code, _, err = command.run(*words)
        assert code in {0, 1}, err
        assert not (tmp_path / "ran").exists()
