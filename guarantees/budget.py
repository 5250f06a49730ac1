"""The committed budget: bytes and instructions that no change may exceed unnoticed."""

import json

from .tools import HERE, Failed, Machine, Task

FILE = HERE / "budget.json"
Numbers = dict[str, dict[str, int]]  # module -> quantity -> how much


def compare(task: Task, target: Machine, measured: Numbers) -> str:
    """What has changed against the budget, in a few words; with task.update it becomes the budget.

    Failed: something is above it, or not in it. With another compiler version than the budget's nothing fails.
    """
    budget = json.loads(FILE.read_text()) if FILE.exists() else {}
    mine = budget.setdefault(target.name, {"compiler": target.version, "modules": {}})
    if task.update:
        mine["compiler"] = target.version
        for module, quantities in measured.items():
            mine["modules"].setdefault(module, {}).update(quantities)
        FILE.write_text(_text(budget))
        return "the budget is this now"
    changed = dict(_changed(mine["modules"], measured))
    if mine["compiler"] != target.version:
        return f"not compared: {target.version}, the budget is of {mine['compiler']}; {len(changed)} numbers differ"
    above = [text for text, more in changed.items() if more]
    if above:
        raise Failed("\n".join([*above, "if that is wanted: python -m noslip.guarantees --update"]))
    return "; ".join(changed) if changed else "as budgeted"


def _changed(budget: Numbers, measured: Numbers):
    """Each difference in words, and whether it is above the budget."""
    for module, quantities in measured.items():
        for quantity, value in quantities.items():
            allowed = budget.get(module, {}).get(quantity)
            if allowed is None:
                yield f"{module} {quantity}: {value}, not in the budget", True
            elif value != allowed:
                yield f"{module} {quantity}: {value}, {value - allowed:+d}", value > allowed


def _text(budget: dict) -> str:
    """JSON with a line for each module."""
    targets = []
    for name, target in sorted(budget.items()):
        lines = [f"   {json.dumps(module)}: {json.dumps(numbers)}" for module, numbers in sorted(target["modules"].items())]
        modules = ",\n".join(lines)
        targets.append(f' "{name}": {{\n  "compiler": {json.dumps(target["compiler"])},\n  "modules": {{\n{modules}\n  }}\n }}')
    return "{\n" + ",\n".join(targets) + "\n}\n"
