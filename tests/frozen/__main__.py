"""Recomputes what is frozen and compares:  PYTHONPATH=tests python -m frozen [--write] [--target LEVEL] [NAME ...]"""

from __future__ import annotations

import argparse
import json
import sys

from frozen.records import FILE, computed, differences, frozen


def main() -> int:
    """Exit status 1 where something differs; with --write it becomes what is frozen."""
    options = argparse.ArgumentParser(prog="frozen", description=__doc__)
    options.add_argument("--write", action="store_true", help="freeze what is computed now")
    options.add_argument("--target", help="processor level to compile for, such as x86-64-v3")
    chosen = options.parse_args()
    kept = frozen() if FILE.exists() else {"programs": {}, "runs": {}}
    found: dict[str, dict[str, object]] = {"programs": {}, "runs": {}}
    changed = 0
    for part, name, digests in computed(chosen.target):
        found[part][name] = digests
        names = differences(kept[part].get(name, {}), digests)
        changed += bool(names)
        if names:
            print(f"{part}: {name}: {', '.join(names)}")
    for part in found:
        for name in kept[part].keys() - found[part].keys():
            changed += 1
            print(f"{part}: {name}: no longer computed")
    print(f"{changed} of {sum(map(len, found.values()))} differ from {FILE.name}")
    if chosen.write:
        FILE.write_text(json.dumps(found, indent=1, sort_keys=True) + "\n", encoding="utf-8")
    return int(changed > 0 and not chosen.write)


if __name__ == "__main__":
    sys.exit(main())
