"""A comparison that needs more than a tenth of its tolerance is found, of every kind; one that needs less,
or a bound, is not."""

import json
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
CLOSE = {
    "less": ("assert abs(x - 1) < 1e-9", 0.3),
    "less in a sum": ("assert x < 1 + 1e-9", 0.3),
    "a factor": ("size = 5.0\n    assert abs(5 * x - 5) <= 1e-9 * size", 0.3),
    "a name": ("LIMITS = {'c': 1e-9}\n    assert np.abs(np.array([1.0, x]) - 1).max() < LIMITS['c']", 0.3),
    "approx": ("assert x == pytest.approx(1.0, rel=1e-9)", 0.3),
    "a list": ("assert [1.0, x] == pytest.approx([1.0, 1.0], abs=1e-9)", 0.3),
    "assert_allclose": ("np.testing.assert_allclose(x, 1.0, rtol=1e-9)", 0.3),
    "allclose": ("assert np.allclose(x, 1.0, 0.0, 1e-9)", 0.3),
    "isclose": ("assert math.isclose(x, 1.0, rel_tol=1e-9)", 0.3),
}
FAR = {
    "wide": "assert abs(x - 1) < 1e-8",
    "approx": "assert x == pytest.approx(1.0, rel=1e-8)",
    "a bound": "assert abs(x) - 1 < 0.0000000009",
    "a defect": "assert x - 1 > 1e-10",
}


def measured(lines: dict[str, str], folder: Path) -> tuple[int, dict[str, float], str]:
    """Runs tests with these lines: the exit code, the part that each needs, and what is printed."""
    head = "import math\nimport numpy as np\nimport pytest\nx = 1 + 3e-10\n"
    tests = "".join(f"\n\ndef test_{k}():\n    {line}\n" for k, line in enumerate(lines.values()))
    (folder / "test_made.py").write_text(head + tests)
    plugin = (
        "import sys; from pathlib import Path; from noslip.tests.margins import Margins; from "
        "noslip.tests import margins\n"
    )
    plugin += f"margins.TESTS = Path({str(folder)!r}); import pytest\n"
    plugin += (
        "sys.exit(pytest.main([sys.argv[1], '-q', '-p', 'no:cacheprovider'], "
        "plugins=[Margins(Path(sys.argv[2]))]))"
    )
    command = [sys.executable, "-c", plugin, str(folder / "test_made.py"), str(folder / "margins.json")]
    done = subprocess.run(command, cwd=folder, capture_output=True, text=True)
    parts = json.loads((folder / "margins.json").read_text())
    return done.returncode, {name: max(places.values()) for name, places in parts.items()}, done.stdout


def test_close_ones_are_found(tmp_path):
    code, parts, said = measured({name: line for name, (line, _) in CLOSE.items()}, tmp_path)
    assert code == 1 and f"{len(CLOSE)} need more than 0.1 of their tolerance" in said
    found = {int(name.split("test_")[-1]): part for name, part in parts.items()}
    assert found == {k: pytest.approx(part, rel=1e-4) for k, (_, part) in enumerate(CLOSE.values())}


def test_others_are_not(tmp_path):
    code, parts, said = measured(FAR, tmp_path)
    assert code == 0 and "0 need more than 0.1" in said and len(parts) == 2
