"""Work shared by processes: what happens when one of them is killed."""

import os
import signal
from multiprocessing.synchronize import SemLock

import pytest
from noslip.checks.verification import shares


@pytest.mark.parametrize("within", ["work", "lock"])
def test_a_killed_process_leaves_its_work_to_the_caller(within, tmp_path, monkeypatch):
    """Killed at its work, or where it would leave a lock behind that nobody gives back: the other ends its
    share, the caller goes on.
    """
    parent, reported = os.getpid(), []

    def killed(*_: object) -> None:
        assert os.getpid() != parent
        os.kill(os.getpid(), signal.SIGKILL)

    def work(k: int) -> None:
        if within == "work" and k == 1:
            killed()
        (tmp_path / str(k)).touch()

    def hangs(*_: object) -> None:
        raise AssertionError("the parent waits for a lock of a killed process")

    monkeypatch.setattr(shares, "processors", lambda: 2)
    if within == "lock":
        monkeypatch.setattr(SemLock, "__exit__", killed)
    before = signal.signal(signal.SIGALRM, hangs)
    signal.alarm(60)
    try:
        shares.in_shares(work, 5, lambda done, of, _: reported.append((done, of)))
    finally:
        signal.alarm(0)
        signal.signal(signal.SIGALRM, before)
    made = {path.name for path in tmp_path.iterdir()}
    assert made == ({"0", "2", "4"} if within == "work" else set("01234"))
    assert reported and all(0 <= done <= len(made) and of == 5 for done, of in reported)
