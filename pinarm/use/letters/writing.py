"""Formulas as a person would write them: short, by accelerations, velocities and the rest."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Mapping, Sequence
from typing import TypeAlias

import sympy
from sympy.simplify.fu import TR8, TR9, TR10i

LARGEST = 24
"""Largest denominator of a fraction that is printed as one; others are printed as decimals."""


def shortest(formula: sympy.Expr) -> sympy.Expr:
    """Return the shortest of some ways to write a formula."""
    plain = sympy.expand(formula)
    if not plain.free_symbols:
        return plain
    reduced = _by_parameters(plain)
    ways = [plain, reduced, sympy.expand(TR8(plain)), TR10i(plain)]
    ways += [sympy.factor_terms(way) for way in ways] + [sympy.factor(reduced)]
    return min(ways, key=_length)


def _by_parameters(plain: sympy.Expr) -> sympy.Expr:
    """Return an expanded formula with the functions of angles that lengths and masses multiply as simplified sums."""
    parts = defaultdict[sympy.Expr, list[sympy.Expr]](list)
    for term in sympy.Add.make_args(plain):
        factor, angular = term.as_independent(sympy.sin, sympy.cos, sympy.tan, as_Add=False)
        number, parameters = factor.as_coeff_Mul()
        parts[parameters].append(number * angular)
    sums = {parameters: sympy.trigsimp(sympy.Add(*terms)) for parameters, terms in parts.items()}
    return sympy.Add(*(parameters * min(TR9(angular), angular, key=_length) for parameters, angular in sums.items()))


def _length(formula: sympy.Expr) -> tuple[int, int]:
    return formula.count_ops(), len(str(formula))


def compact(formula: sympy.Expr, seconds: Sequence[sympy.Symbol], rates: Sequence[sympy.Symbol]) -> sympy.Expr:
    """Return a formula that is linear in accelerations as a sum by these, products of velocities and the rest."""
    plain = sympy.expand(formula)
    terms = []
    for second in seconds:
        terms.append(shortest(plain.coeff(second, 1)) * second)
        plain = plain.coeff(second, 0)
    products = sympy.Poly(plain, *rates).terms() if rates else [((), plain)]
    for powers, coefficient in products:
        product = sympy.Mul(*(rate**power for rate, power in zip(rates, powers, strict=True)))
        terms.append(shortest(coefficient) * product)
    whole = sympy.Add(*terms)
    return min((whole, shortest(whole)), key=lambda way: way.count_ops())


def decimals(formula: sympy.Expr) -> sympy.Expr:
    """Return a formula whose fractions with large denominators are decimals."""
    long = {number: sympy.Float(number, 15) for number in formula.atoms(sympy.Rational) if number.q > LARGEST}
    return formula.xreplace(long)


def written(formula: sympy.Expr) -> str:
    """Return a formula as text that formulas of files can take."""
    return str(sympy.sstr(decimals(formula), full_prec=False))


Dots: TypeAlias = Mapping[sympy.Symbol, tuple[sympy.Symbol, str]]
"""Symbol of a velocity or an acceleration -> that of the position, and ``dot`` or ``ddot``."""

ACCENTS = {"dot": "\u02d9", "ddot": "\u00a8"}


def latex(formula: sympy.Expr, dots: Dots) -> str:
    """Return a formula in LaTeX, velocities and accelerations with dots."""
    names = {symbol: rf"\{mark}{{{sympy.latex(value)}}}" for symbol, (value, mark) in dots.items()}
    return str(sympy.latex(decimals(formula), symbol_names=names))


def mathml(formula: sympy.Expr, dots: Dots) -> str:
    """Return a formula in MathML, an element for each term: lines of a page break between them."""
    marks = {sympy.Symbol("DOTTED" + chr(ord("A") + k)): place for k, place in enumerate(dots.items())}
    placed = decimals(formula).xreplace({symbol: mark for mark, (symbol, _) in marks.items()})
    page = " ".join(_term(term, first=not k) for k, term in enumerate(placed.as_ordered_terms()))
    for mark, (_, (value, accent)) in marks.items():
        dotted = f'{_presentation(value)}<mstyle scriptlevel="0"><mtext>{ACCENTS[accent]}</mtext></mstyle>'
        page = page.replace(f"<mi>{mark}</mi>", f"<mover>{dotted}</mover>")
    return page


def _term(term: sympy.Expr, *, first: bool) -> str:
    minus = bool(term.could_extract_minus_sign())
    sign = "\u2212" if minus else "" if first else "+"
    content = _presentation(-term if minus else term)
    drawn = f"<mo>{sign}</mo><mtext>&#8201;</mtext>{content}" if sign else content
    return f'<math displaystyle="true">{drawn}</math>'


def _presentation(formula: sympy.Expr) -> str:
    from sympy.printing.mathml import mathml as printed

    return str(printed(formula, printer="presentation")).replace("<mo>&InvisibleTimes;</mo>", "<mtext>&#8201;</mtext>")
