"""Mutants of a module, drawn by a seed from all that the operators can make of its syntax tree."""

from __future__ import annotations

import ast
import random
import re
from collections.abc import Iterator
from dataclasses import dataclass

from mutants_bench.mutant import Mutant

COMPARISONS: dict[type[ast.cmpop], tuple[str, tuple[str, ...]]] = {
    ast.Lt: ("<", ("<=", ">=")),
    ast.LtE: ("<=", ("<", ">")),
    ast.Gt: (">", (">=", "<=")),
    ast.GtE: (">=", (">", "<")),
    ast.Eq: ("==", ("!=",)),
    ast.NotEq: ("!=", ("==",)),
    ast.Is: ("is", ("is not",)),
    ast.IsNot: ("is not", ("is",)),
    ast.In: ("in", ("not in",)),
    ast.NotIn: ("not in", ("in",)),
}
ARITHMETIC: dict[type[ast.operator], tuple[str, str]] = {
    ast.Add: ("+", "-"),
    ast.Sub: ("-", "+"),
    ast.Mult: ("*", "/"),
    ast.Div: ("/", "*"),
    ast.FloorDiv: ("//", "*"),
}
NAMES = {
    "max": "min",
    "min": "max",
    "any": "all",
    "all": "any",
    "abs": "float",
    "floor": "ceil",
    "ceil": "floor",
}
SKIPPED = ("TYPE_CHECKING", "__all__")


@dataclass(frozen=True)
class Edit:
    """A replacement in the bytes of a source file."""

    begin: int
    end: int
    text: str
    what: str


class _Finder(ast.NodeVisitor):
    """Collects edits; leaves out what nobody executes or only a message says."""

    def __init__(self, source: bytes) -> None:
        self.source = source
        self.starts = [0]
        for line in source.splitlines(keepends=True):
            self.starts.append(self.starts[-1] + len(line))
        self.edits: list[Edit] = []

    def _span(self, node: ast.expr | ast.stmt) -> tuple[int, int]:
        if node.end_lineno is None or node.end_col_offset is None:
            raise ValueError("a node that was not parsed from a text has no end")
        begin = self.starts[node.lineno - 1] + node.col_offset
        end = self.starts[node.end_lineno - 1] + node.end_col_offset
        return begin, end

    def _between(self, left: ast.expr, right: ast.expr, old: str, new: str, what: str) -> None:
        begin, end = self._span(left)[1], self._span(right)[0]
        text = self.source[begin:end].decode()
        pattern = rf"\b{old}\b" if old[0].isalpha() else re.escape(old)
        found = list(re.finditer(pattern, text))
        if len(found) == 1:
            at = begin + found[0].start()
            self.edits.append(Edit(at, at + len(old), new, f"{what}: {old} -> {new}"))

    def _whole(self, node: ast.expr | ast.stmt, new: str, what: str) -> None:
        begin, end = self._span(node)
        self.edits.append(Edit(begin, end, new, what))

    # -- left out

    def visit_JoinedStr(self, node: ast.JoinedStr) -> None:
        """Messages."""

    def visit_AnnAssign(self, node: ast.AnnAssign) -> None:
        if node.value is not None:
            self.visit(node.value)

    def visit_FunctionDef(self, node: ast.FunctionDef) -> None:
        for default in (*node.args.defaults, *node.args.kw_defaults):
            if default is not None:
                self.visit(default)
        self._body(node.body)

    def visit_ClassDef(self, node: ast.ClassDef) -> None:
        self._body(node.body)

    def _body(self, body: list[ast.stmt]) -> None:
        for statement in body:
            if not (isinstance(statement, ast.Expr) and isinstance(statement.value, ast.Constant)):
                self.visit(statement)

    def visit_Module(self, node: ast.Module) -> None:
        self._body(node.body)

    def visit_Subscript(self, node: ast.Subscript) -> None:
        self.visit(node.value)
        if not isinstance(node.value, ast.Name) or not node.value.id[:1].isupper():  # a type
            self.visit(node.slice)

    # -- operators

    def visit_Compare(self, node: ast.Compare) -> None:
        for left, op, right in zip([node.left, *node.comparators], node.ops, node.comparators, strict=False):
            old, others = COMPARISONS[type(op)]
            for new in others:
                self._between(left, right, old, new, "boundary" if new[0] == old[0] else "comparison")
        self.generic_visit(node)

    def visit_BoolOp(self, node: ast.BoolOp) -> None:
        old, new = ("and", "or") if isinstance(node.op, ast.And) else ("or", "and")
        for left, right in zip(node.values, node.values[1:], strict=False):
            self._between(left, right, old, new, "boolean")
        self.generic_visit(node)

    def visit_UnaryOp(self, node: ast.UnaryOp) -> None:
        begin, end = self._span(node.operand)
        if isinstance(node.op, ast.Not | ast.USub) and not isinstance(node.operand, ast.BoolOp):
            what = "not dropped" if isinstance(node.op, ast.Not) else "sign"
            self._whole(node, self.source[begin:end].decode(), what)
        self.generic_visit(node)

    def visit_BinOp(self, node: ast.BinOp) -> None:
        if type(node.op) in ARITHMETIC and not any(
            isinstance(side, ast.JoinedStr | ast.List | ast.Tuple)
            or (isinstance(side, ast.Constant) and isinstance(side.value, str | bytes))
            for side in (node.left, node.right)
        ):
            old, new = ARITHMETIC[type(node.op)]
            self._between(node.left, node.right, old, new, "arithmetic")
        self.generic_visit(node)

    def visit_Constant(self, node: ast.Constant) -> None:
        value = node.value
        if isinstance(value, bool):
            self._whole(node, str(not value), "constant")
        elif isinstance(value, int):
            self._whole(node, str(value + 1), f"constant: {value} -> {value + 1}")
        elif isinstance(value, float):
            new = repr(value * 2.0 if value else 1.0)
            self._whole(node, new, f"constant: {value} -> {new}")

    def visit_Raise(self, node: ast.Raise) -> None:
        if node.exc is not None:
            self._whole(node, "pass", "raise dropped")

    def visit_Call(self, node: ast.Call) -> None:
        if isinstance(node.func, ast.Name) and node.func.id in NAMES:
            self._whole(node.func, NAMES[node.func.id], f"call: {node.func.id} -> {NAMES[node.func.id]}")
        plain = [a for a in node.args if not isinstance(a, ast.Starred)]
        if len(plain) >= 2 and len(plain) == len(node.args):
            (a, b), (c, d) = self._span(plain[0]), self._span(plain[1])
            first, second = self.source[a:b], self.source[c:d]
            if first != second and b"\n" not in first + second:
                swapped = second + self.source[b:c] + first
                self.edits.append(Edit(a, d, swapped.decode(), "arguments swapped"))
        self.generic_visit(node)

    def visit_Expr(self, node: ast.Expr) -> None:
        if isinstance(node.value, ast.Call):
            self._whole(node, "pass", "statement dropped")
        self.generic_visit(node)

    def visit_AugAssign(self, node: ast.AugAssign) -> None:
        self._whole(node, "pass", "statement dropped")
        self.generic_visit(node)


def edits_of(source: str) -> list[Edit]:
    """All that the operators make of a module; those that do not compile are left out."""
    data = source.encode()
    finder = _Finder(data)
    finder.visit(ast.parse(source))
    return [edit for edit in finder.edits if _compiles(_applied(data, edit))]


def _applied(data: bytes, edit: Edit) -> bytes:
    return data[: edit.begin] + edit.text.encode() + data[edit.end :]


def _compiles(data: bytes) -> bool:
    try:
        ast.parse(data)
    except SyntaxError:
        return False
    return True


def _as_texts(source: str, edit: Edit) -> tuple[str, str] | None:
    """Whole lines that stand once in the file, and what becomes of them."""
    data = source.encode()
    begin = data.rfind(b"\n", 0, edit.begin) + 1
    end = data.find(b"\n", edit.end)
    for _ in range(12):
        old = data[begin:end].decode()
        if source.count(old) == 1:
            longer = len(edit.text.encode()) - (edit.end - edit.begin)
            return old, _applied(data, edit)[begin : end + longer].decode()
        if begin == 0:
            return None
        begin = data.rfind(b"\n", 0, begin - 1) + 1
    return None


def drawn(file: str, source: str, count: int, seed: int) -> Iterator[Mutant]:
    """So many mutants of a module, spread over its kinds of change and its functions; fewer if there are no more."""
    draw = random.Random(f"{seed} {file}")
    left = edits_of(source)
    draw.shuffle(left)
    taken: list[Edit] = []
    kinds: dict[str, int] = {}
    while left and len(taken) < count:
        # the kind that is rarest so far, and no two in one place
        edit = min(left, key=lambda e: kinds.get(e.what.partition(":")[0], 0))
        left.remove(edit)
        if any(e.begin < edit.end and edit.begin < e.end for e in taken):
            continue
        texts = _as_texts(source, edit)
        if texts is None or texts[0] == texts[1]:
            continue
        kinds[edit.what.partition(":")[0]] = kinds.get(edit.what.partition(":")[0], 0) + 1
        taken.append(edit)
        line = source.encode()[: edit.begin].count(b"\n") + 1
        yield Mutant(f"{file}:{line}:{edit.begin}", file, *texts, edit.what)
