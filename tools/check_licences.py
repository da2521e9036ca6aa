#!/usr/bin/env python3
"""Licences of all crates that the workspace builds on, against the list in deny.toml. Ends with 1 when one is not on it.

    tools/check_licences.py            from the root of the repository

`cargo deny check licenses` does the same and more; this needs nothing installed.
"""

import json
import re
import subprocess
import sys
import tomllib


def allowed(expression, allow):
    """Whether an SPDX expression (AND binds closer than OR, brackets) can be met with the allowed licences."""
    tokens = re.findall(r"\(|\)|[^\s()]+", expression.replace("/", " OR "))

    def either(i):
        value, i = both(i)
        while i < len(tokens) and tokens[i] == "OR":
            other, i = both(i + 1)
            value = value or other
        return value, i

    def both(i):
        value, i = one(i)
        while i < len(tokens) and tokens[i] == "AND":
            other, i = one(i + 1)
            value = value and other
        return value, i

    def one(i):
        if tokens[i] == "(":
            value, i = either(i + 1)
            return value, i + 1
        name, i = tokens[i], i + 1
        if i + 1 < len(tokens) and tokens[i] == "WITH":
            return f"{name} WITH {tokens[i + 1]}" in allow or name in allow, i + 2
        return name in allow, i

    return either(0)[0]


def main():
    with open("deny.toml", "rb") as f:
        allow = set(tomllib.load(f)["licenses"]["allow"])
    metadata = json.loads(
        subprocess.run(
            ["cargo", "metadata", "--format-version", "1", "--locked"], check=True, stdout=subprocess.PIPE
        ).stdout
    )
    wrong = [
        f"{p['name']} {p['version']}: {p['license'] or 'no licence stated'}"
        for p in metadata["packages"]
        if not p["license"] or not allowed(p["license"], allow)
    ]
    for line in wrong:
        print(line)
    print(f"licences: {len(metadata['packages'])} crates, {len(wrong)} not allowed by deny.toml")
    return 1 if wrong else 0


if __name__ == "__main__":
    assert allowed("MIT OR (GPL-3.0 AND Zlib)", {"MIT"}) and not allowed("MIT AND GPL-3.0", {"MIT"})
    sys.exit(main())
