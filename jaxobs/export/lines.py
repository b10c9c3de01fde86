"""The lines of straight-line code, made from equations between numbers: each computed once, none in vain."""

from collections.abc import Iterable, Iterator
from typing import Any, NamedTuple

import numpy as np

from jaxobs import scalars
from jaxobs.export.unrolled import Unsupported, refused


class Ref(NamedTuple):
    """The number that a line defined."""

    number: int


class Cell(NamedTuple):
    """An entry of what is given: of "z", "u", "y", "k", "xhat0" or a table."""

    of: str
    number: int


Operand = Ref | Cell | np.generic


class Assign(NamedTuple):
    """target = op(operands); `given`: the dtype of the operands."""

    target: int
    dtype: np.dtype
    op: str
    operands: tuple[Operand, ...]
    given: np.dtype


class Carried(NamedTuple):
    """A number that goes around a loop."""

    target: int
    dtype: np.dtype
    start: Operand
    ahead: Operand


class Loop(NamedTuple):
    """`length` times: the body, then all of `carried` at once take their next values."""

    length: int
    carried: tuple[Carried, ...]
    body: tuple["Line", ...]


Line = Assign | Loop

SAME = ("copy", "copy_p", "stop_gradient", "name", "optimization_barrier", "reshape", "squeeze", "broadcast_in_dim")
_FLOATS = """
    abs acos acosh add asin asinh atan atan2 atanh cbrt ceil convert cos cosh div eq erf erfc exp exp2 expm1 floor ge gt le
    lgamma log log1p lt max min mul ne neg pow rem round_away round_even select sign sin sinh sqrt sub tan tanh
"""
DTYPES = ("float32", "float64", "int32", "int64", "uint32", "bool")
FLOATS = frozenset(_FLOATS.split())
WHOLES = frozenset(("abs", "add", "convert", "eq", "ge", "gt", "le", "lt", "max", "min", "mul", "ne", "neg", "select", "sub"))
TRUTHS = frozenset(("and", "convert", "eq", "ne", "not", "or", "select", "xor"))


def assigned(program: Any, where: dict[Any, Operand]) -> tuple[Line, ...]:
    """The program's equations as lines; `where` has its inputs, and gets all that they define."""
    writer = _Writer(where, {}, [0])
    writer.equations(program)
    return tuple(writer.lines)


class _Writer:
    """Lines in order; what was computed before, in this block or around it, is not computed again."""

    def __init__(self, where: dict[Any, Operand], seen: dict[Any, Ref], count: list[int]):
        self.where, self.seen, self.count = where, dict(seen), count
        self.made: dict[Any, Assign] = {}
        self.lines: list[Line] = []

    def equations(self, program: Any) -> None:
        for variable, value in program.constants.items():
            if variable.aval.shape == ():
                self.where[variable] = _scalar(np.asarray(value))
        for equation in program.equations:
            if equation.primitive.name == "scan":
                self.scan(equation)
                continue
            if len(equation.outputs) != 1 or equation.outputs[0].aval.shape != ():
                raise refused(equation)
            operands = [self.operand(one, equation) for one in equation.inputs]
            self.where[equation.outputs[0]] = self.value(equation, operands)

    def operand(self, atom: Any, equation: Any) -> Operand:
        if isinstance(atom, np.ndarray):
            if atom.shape != ():
                raise refused(equation)
            return _scalar(atom)
        if atom not in self.where:
            raise refused(equation)
        return self.where[atom]

    def value(self, equation: Any, operands: list[Operand]) -> Operand:
        """The number that a primitive makes, by one operation or several."""
        name, params = equation.primitive.name, equation.params
        given, dtype = (
            np.dtype(equation.inputs[0].dtype if isinstance(equation.inputs[0], np.ndarray) else equation.inputs[0].aval.dtype),
            np.dtype(equation.outputs[0].aval.dtype),
        )

        def op(name: str, *operands: Operand) -> Operand:
            return self.assign(equation, name, dtype, operands, given)

        if name in SAME:
            return operands[0]
        one = _scalar(np.ones((), dtype))
        match name:
            case "convert_element_type":
                return operands[0] if given == dtype else op("convert", *operands)
            case "add_any":
                return op("add", *operands)
            case "square":
                return op("mul", operands[0], operands[0])
            case "integer_pow":
                return self.power(operands[0], params["y"], op, one)
            case "logistic":
                return op("div", one, op("add", one, op("exp", op("neg", operands[0]))))
            case "rsqrt":
                return op("div", one, op("sqrt", operands[0]))
            case "clamp":
                low, x, high = operands
                return op("min", op("max", x, low), high)
            case "round":
                return op("round_even" if int(params["rounding_method"]) else "round_away", *operands)
            case "select_n":
                if given != np.bool_ or len(operands) != 3:
                    raise refused(equation)
                return op("select", *operands)
        return op(name, *operands)

    @staticmethod
    def power(x: Operand, exponent: int, op: Any, one: Any) -> Operand:
        """By squares; in integers and floats alike."""
        count, square, product = abs(exponent), x, None
        while count:
            if count & 1:
                product = square if product is None else op("mul", product, square)
            count >>= 1
            square = op("mul", square, square) if count else square
        product = one if product is None else product
        return op("div", one, product) if exponent < 0 else product

    def assign(self, equation: Any, name: str, dtype: np.dtype, operands: tuple[Operand, ...], given: np.dtype) -> Operand:
        kind = dtype if name in ("select", "is_finite") else given
        known = {"f": FLOATS, "i": WHOLES, "u": WHOLES, "b": TRUTHS}.get(kind.kind, frozenset()) | {"is_finite"}
        if name not in known:
            if kind.kind == "f":
                raise refused(equation)
            raise Unsupported(name, f"{name} of floats (given {kind})", "Write the model with floats, or export StableHLO.")
        if dtype.name not in DTYPES:
            fix = "Write the model in float32 or float64, or export StableHLO."
            raise Unsupported(name, f"numbers of {', '.join(DTYPES)} (given {dtype})", fix)
        if name == "select":
            operands = self.chosen(*operands)
        if name == "mul" and any(isinstance(one, np.floating) and one == -1 for one in operands):
            rest = [one for one in operands if not (isinstance(one, np.floating) and one == -1)]
            return self.assign(equation, "neg", dtype, (rest[0],), given)
        if name == "neg" and (inner := self.made.get(operands[0])) is not None and inner.op == "neg":
            return inner.operands[0]
        key = (name, dtype, given, tuple((type(one), one if isinstance(one, tuple) else one.tobytes()) for one in operands))
        if key not in self.seen:
            self.seen[key] = self.fresh()
            line = Assign(self.seen[key].number, dtype, name, operands, given)
            self.lines.append(line)
            self.made[self.seen[key]] = line
        return self.seen[key]

    def chosen(self, truth: Operand, otherwise: Operand, then: Operand) -> tuple[Operand, ...]:
        """A choice by the same truth inside a choice is made already."""
        cases = [truth, otherwise, then]
        for i in (1, 2):
            inner = self.made.get(cases[i])
            if inner is not None and inner.op == "select" and inner.operands[0] == truth:
                cases[i] = inner.operands[i]
        return tuple(cases)

    def fresh(self) -> Ref:
        self.count[0] += 1
        return Ref(self.count[0] - 1)

    def scan(self, equation: Any) -> None:
        """A scan that only carries numbers."""
        params = equation.params
        consts, carried = params["num_consts"], params["num_carry"]
        scalar = all(one.aval.shape == () for one in equation.outputs)
        if len(equation.inputs) != consts + carried or len(equation.outputs) != carried or params["reverse"] or not scalar:
            raise refused(equation)
        body = scalars.flatten(params["jaxpr"])
        given = [self.operand(one, equation) for one in equation.inputs]
        targets = [self.fresh() for _ in range(carried)]
        where = self.where | dict(zip(body.inputs, [*given[:consts], *targets], strict=True))
        inner = _Writer(where, self.seen, self.count)
        inner.equations(body)
        ahead = [inner.operand(one, equation) for one in body.outputs]
        turns = [
            Carried(target.number, np.dtype(one.aval.dtype), start, after)
            for target, one, start, after in zip(targets, equation.outputs, given[consts:], ahead, strict=True)
        ]
        self.lines.append(Loop(params["length"], tuple(turns), tuple(inner.lines)))
        self.where |= zip(equation.outputs, targets, strict=True)


def _scalar(array: np.ndarray) -> np.generic:
    return array.dtype.type(array)


def read(lines: Iterable[Line], results: Iterable[Operand] = ()) -> Iterator[Operand]:
    """All operands of the lines, and the results."""
    yield from results
    for line in lines:
        if isinstance(line, Assign):
            yield from line.operands
        else:
            yield from read(line.body, [end for one in line.carried for end in (one.start, one.ahead)])


def needed(lines: tuple[Line, ...], results: Iterable[Operand]) -> tuple[Line, ...]:
    """The lines that the results depend on."""
    live = {one.number for one in results if isinstance(one, Ref)}
    kept: list[Line] = []
    for line in reversed(lines):
        if isinstance(line, Assign):
            if line.target not in live:
                continue
        else:
            line = _pruned(line, live)
            if not line.carried:
                continue
        kept.append(line)
        live |= {one.number for one in read([line]) if isinstance(one, Ref)}
    return tuple(reversed(kept))


def _pruned(loop: Loop, live: set[int]) -> Loop:
    """The loop with only those numbers that what is live depends on."""
    wanted = {one.target for one in loop.carried if one.target in live}
    while True:
        carried = tuple(one for one in loop.carried if one.target in wanted)
        body = needed(loop.body, [one.ahead for one in carried])
        inside = {one.number for one in read(body, [c.ahead for c in carried]) if isinstance(one, Ref)}
        more = wanted | {one.target for one in loop.carried if one.target in inside}
        if more == wanted:
            return Loop(loop.length, carried, body)
        wanted = more
