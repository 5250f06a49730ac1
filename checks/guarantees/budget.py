"""The committed budget: maximum numbers of bytes and instructions; a change that exceeds them fails."""

import json

from .tools import HERE, Failed, Machine, Task

FILE = HERE / "budget.json"
Numbers = dict[str, dict[str, int]]  # module -> quantity -> value


def compare(task: Task, target: Machine, measured: Numbers) -> str:
    """Compare measured numbers with the budget and return a summary of the differences; with task.update,
    record them instead.

    Raises Failed if a number exceeds the budget or is missing from it, unless the budget is of another
    compiler version.
    """
    budget = json.loads(FILE.read_text(encoding="utf-8")) if FILE.exists() else {}
    mine = budget.setdefault(target.name, {"compiler": target.version, "modules": {}})
    if task.update:
        mine["compiler"] = target.version
        for module, quantities in measured.items():
            mine["modules"].setdefault(module, {}).update(quantities)
        FILE.write_text(_text(budget), encoding="utf-8")
        return "recorded as the new budget"
    changed = dict(_changed(mine["modules"], measured))
    if mine["compiler"] != target.version:
        return (
            f"not compared: {target.version}, the budget is of {mine['compiler']}; {len(changed)} numbers "
            "differ"
        )
    above = [text for text, more in changed.items() if more]
    if above:
        raise Failed("\n".join([*above, "if this is intended: python -m noslip.checks.guarantees --update"]))
    return "; ".join(changed) if changed else "as budgeted"


def _changed(budget: Numbers, measured: Numbers):
    """Yield a description of each difference, and whether the budget is exceeded."""
    for module, quantities in measured.items():
        for quantity, value in quantities.items():
            allowed = budget.get(module, {}).get(quantity)
            if allowed is None:
                yield f"{module} {quantity}: {value}, not in the budget", True
            elif value != allowed:
                yield f"{module} {quantity}: {value}, {value - allowed:+d}", value > allowed


def _text(budget: dict) -> str:
    """Return the budget as JSON with a line for each module."""
    targets = []
    for name, target in sorted(budget.items()):
        lines = [
            f"   {json.dumps(module)}: {json.dumps(numbers)}"
            for module, numbers in sorted(target["modules"].items())
        ]
        modules = ",\n".join(lines)
        targets.append(
            f' "{name}": {{\n  "compiler": {json.dumps(target["compiler"])},\n  "modules": {{\n{modules}\n  '
            "}\n }"
        )
    return "{\n" + ",\n".join(targets) + "\n}\n"
