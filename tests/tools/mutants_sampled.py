"""Mutants that are sampled: one operator, number or function of a formula is another one, wherever a seeded draw falls.

What a person thinks of (`mutants_list.py`) is what a person also tests. These know nothing of the tests.
"""

import ast
import random
from collections.abc import Iterator, Mapping
from pathlib import Path

from mutants_list import Mutant
from mutants_targets import EQUIVALENT, TARGETS

SEED = 0
OPERATORS: Mapping[type, str] = {ast.Add: "-", ast.Sub: "+", ast.Mult: "/", ast.Div: "*"}
SIGNS: Mapping[type, str] = {ast.Add: "+", ast.Sub: "-", ast.Mult: "*", ast.Div: "/"}
TURNED: Mapping[type, tuple[str, str]] = {
    ast.Lt: ("<", ">="),
    ast.LtE: ("<=", ">"),
    ast.Gt: (">", "<="),
    ast.GtE: (">=", "<"),
}
SWAPPED = {
    "real": "imag",
    "imag": "real",
    "sin": "cos",
    "cos": "sin",
    "conj": "asarray",
    "sqrt": "square",
    "exp": "log1p",
    "maximum": "minimum",
    "minimum": "maximum",
    "argmax": "argmin",
    "argmin": "argmax",
    "cumsum": "asarray",
}
# What follows is said, checked or typed, and computes nothing.
SILENT = (ast.Raise, ast.JoinedStr, ast.Assert, ast.Import, ast.ImportFrom, ast.arg, ast.Subscript)


def sampled(tree: Path) -> tuple[Mutant, ...]:
    """The sampled mutants of a tree; those that are known to change nothing are left out."""
    found: list[Mutant] = []
    for target in TARGETS:
        path = tree / target.file
        if not path.exists():
            raise FileNotFoundError(f"{path}: a target of the sampled mutants has moved; see mutants_targets.py")
        everything = list(changes(path.read_text()))
        draw = random.Random(f"{SEED} {target.file}")
        for function, old, new, words in draw.sample(everything, min(target.mutants, len(everything))):
            name = f"{path.stem}.{function}: {words}"
            if name not in EQUIVALENT and name not in {one.name for one in found}:
                how = {"select": target.select, "slow": target.slow, "file": target.file}
                found.append(Mutant(name, f"In {target.file}: {words}.", ((old, new),), target.tests, **how))
    return tuple(found)


def changes(text: str) -> Iterator[tuple[str, str, str, str]]:
    """Function, text, changed text and words of every change of a file that stands in the file once."""
    lines = text.splitlines(keepends=True)
    begins = [0]
    for line in lines:
        begins.append(begins[-1] + len(line.encode()))
    coded = text.encode()
    for function in _functions(ast.parse(text)):
        for node in _computing(function):
            for begin, end, new in _changed(node, coded, begins):
                # Whole lines, with a neighbour on both sides, because a short line may stand in other files too.
                first = max(text[: len(coded[:begin].decode())].count("\n") - 1, 0)
                last = min(text[: len(coded[:end].decode())].count("\n") + 1, len(lines) - 1)
                old_lines = "".join(lines[first : last + 1])
                if text.count(old_lines) != 1:
                    continue
                changed = coded[begins[first] : begin] + new.encode() + coded[end : begins[last + 1]]
                was = coded[begin:end].decode().strip()
                context = " ".join(ast.unparse(node).split())
                words = f"{was} -> {new.strip()} in {context if len(context) < 60 else context[:57] + '...'}"
                yield function.name, old_lines, changed.decode(), words


def _functions(tree: ast.AST) -> Iterator[ast.FunctionDef]:
    for node in ast.walk(tree):
        if isinstance(node, ast.FunctionDef):
            yield node


def _computing(function: ast.FunctionDef) -> Iterator[ast.expr]:
    """Expressions that compute, not those of nested functions, messages, checks that raise, types and indices."""
    waiting: list[ast.AST] = list(function.body)
    while waiting:
        node = waiting.pop()
        if isinstance(node, (*SILENT, ast.FunctionDef, ast.Lambda)):
            continue
        if isinstance(node, ast.If) and any(isinstance(one, ast.Raise) for one in node.body):
            waiting += node.orelse
            continue
        if isinstance(node, ast.AnnAssign):
            waiting += [node.value] if node.value else []
            continue
        if isinstance(node, ast.expr):
            yield node
        waiting += ast.iter_child_nodes(node)


def _changed(node: ast.expr, coded: bytes, begins: list[int]) -> Iterator[tuple[int, int, str]]:
    """Begin and end (bytes) of what is changed in a node itself, and what comes in its place."""

    def begin(of: ast.expr) -> int:
        return begins[of.lineno - 1] + of.col_offset

    def end(of: ast.expr) -> int:
        return begins[(of.end_lineno or of.lineno) - 1] + (of.end_col_offset or 0)

    def between(left: ast.expr, right: ast.expr, sign: str) -> tuple[int, int] | None:
        at = coded.find(sign.encode(), end(left), begin(right))
        return None if at < 0 else (at, at + len(sign))

    if isinstance(node, ast.BinOp) and type(node.op) in OPERATORS:
        place = between(node.left, node.right, SIGNS[type(node.op)])
        if place:
            yield *place, OPERATORS[type(node.op)]
    if isinstance(node, ast.BinOp):
        for side in (node.left, node.right):
            if isinstance(side, ast.Constant) and isinstance(side.value, int | float) and side.value:
                yield begin(side), end(side), repr(side.value + 1 if isinstance(side.value, int) else 2 * side.value)
    if isinstance(node, ast.Compare) and len(node.ops) == 1 and type(node.ops[0]) in TURNED:
        sign, other = TURNED[type(node.ops[0])]
        place = between(node.left, node.comparators[0], sign)
        if place:
            yield *place, other
    if isinstance(node, ast.UnaryOp) and isinstance(node.op, ast.USub) and not isinstance(node.operand, ast.Constant):
        yield begin(node), begin(node) + 1, " "
    if isinstance(node, ast.Attribute) and node.attr in SWAPPED:
        yield end(node) - len(node.attr), end(node), SWAPPED[node.attr]
