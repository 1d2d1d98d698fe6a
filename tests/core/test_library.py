"""Library terms: names, codes, rows, and the exact way back from standardised to raw columns."""

import math
from fractions import Fraction

import numpy as np
import pytest
from every import every
from hypothesis import given
from hypothesis import strategies as st
from unjitted import unjitted

from launchid_core.algebra import library
from launchid_core.algebra.library import (
    FUNCTIONS,
    LIBRARIES,
    MAX_POWER,
    MAX_TERMS,
    N_VARIABLES,
    TAU,
    VARIABLES,
    centred_variables,
    default_own_share,
    library_terms,
    parse_term,
    polynomial,
    term_codes,
    term_name,
)

function_value, library_column, raw_from_standard = map(unjitted, (
    library.function_value, library.library_column, library.raw_from_standard))

EPS = np.finfo(np.float64).eps
powers = st.tuples(*[st.integers(0, MAX_POWER)] * N_VARIABLES)
functions = st.one_of(st.just((0, 0)), st.tuples(st.integers(1, 3), st.integers(0, TAU - 1)))
codes = st.builds(lambda power, function: (*power, *function), powers, functions)
small = st.integers(-3, 3)
four = st.lists(small, min_size=4, max_size=4)


def row_of(terms, raw, z):
    """One row of the standardised library."""
    raw, z, row = np.array(raw, dtype=float), np.array(z, dtype=float).reshape(4, 1), np.full(len(terms), np.nan)
    for j, code in enumerate(term_codes(terms)):
        library_column(code, z, raw[code[5]:code[5] + 1], 1, row[j:j + 1])
    return row


def transform(terms, centre, scale):
    """T transposed."""
    tt = np.full((len(terms), len(terms)), np.nan)
    raw_from_standard(term_codes(terms), np.array(centre, dtype=float), np.array(scale, dtype=float), tt)
    return tt


def raw_term(code, raw):
    """Value of a term at a raw sample, in rationals but for the function's value, which math gives."""
    value = Fraction(1)
    for variable in range(N_VARIABLES):
        value *= Fraction(raw[variable]) ** int(code[variable])
    if code[4]:
        x = float(raw[code[5]])
        value *= Fraction((math.sin(x), math.cos(x), float(np.sign(x)))[code[4] - 1])
    return value


# ---------------------------------------------------------------- laws


@given(codes)
def test_name_and_code_are_inverse(code):
    assert parse_term(term_name(code)) == code


@given(codes, st.randoms())
def test_factors_commute_and_spaces_do_not_count(code, random):
    factors = term_name(code).split("*")
    random.shuffle(factors)
    assert parse_term(" * ".join(factors)) == code


@given(st.lists(st.sampled_from(VARIABLES), min_size=1, max_size=MAX_POWER))
def test_repeated_factors_multiply(factors):
    code = parse_term("*".join(factors))
    assert code == (*(factors.count(name) for name in VARIABLES), 0, 0)


@given(st.integers(0, 4))
def test_polynomial_holds_every_monomial_once_by_degree(order):
    """Orders above 4 exceed MAX_TERMS as a library, but not as names."""
    found = [parse_term(name) for name in polynomial(order)]
    assert len(set(found)) == len(found) == math.comb(order + 3, 3)
    degrees = [sum(code[:3]) for code in found]
    assert degrees == sorted(degrees)
    assert max(degrees) == order
    assert all(code[3:] == (0, 0, 0) for code in found)


@given(st.lists(codes, min_size=1, max_size=8, unique=True), four)
def test_row_of_raw_samples_is_the_product_of_the_factors(wanted, raw):
    terms = tuple(term_name(code) for code in wanted)
    for value, code in zip(row_of(terms, raw, raw), wanted, strict=True):
        assert math.isclose(value, float(raw_term(code, raw)), rel_tol=32 * EPS)


@given(st.lists(codes, min_size=1, max_size=8, unique=True), st.integers(0, 2**32 - 1))
def test_any_library_returns_to_raw(wanted, seed):
    rng = np.random.default_rng(seed)
    wanted = [(*(min(p, 2) for p in code[:4]), *code[4:]) for code in wanted]
    terms = tuple(dict.fromkeys(term_name(code) for code in wanted))
    centre = rng.uniform(-1, 1, 4) * centred_variables(term_codes(terms))
    scale, z = rng.uniform(0.5, 2.0, 4), rng.uniform(-2, 2, 4)
    raw = centre + scale * z
    tt = transform(terms, centre, scale)
    standard = row_of(terms, raw, z)
    for i, code in enumerate(term_codes(terms)):
        size = float(np.abs(tt[i]) @ np.abs(standard))
        assert abs(tt[i] @ standard - float(raw_term(code, raw))) <= 100 * EPS * size


@given(st.lists(codes, min_size=1, max_size=12, unique=True))
def test_a_variable_is_centred_exactly_where_the_library_is_closed_downwards(wanted):
    allowed = centred_variables(term_codes(tuple(term_name(code) for code in wanted)))
    for variable in range(TAU):
        lower = {(*code[:variable], power, *code[variable + 1:]) for code in wanted for power in range(code[variable])}
        assert allowed[variable] == int(bool(lower) and lower <= set(wanted))
    assert allowed[TAU] == 0


@given(st.sampled_from(sorted(LIBRARIES)))
def test_named_libraries_are_canonical(name):
    assert library_terms(name) == LIBRARIES[name] == library_terms(",".join(LIBRARIES[name]))


# ---------------------------------------------------------------- degenerate cases


def test_constant_term():
    assert parse_term("1") == (0, 0, 0, 0, 0, 0)
    assert term_name((0, 0, 0, 0, 0, 0)) == "1"
    assert row_of(("1",), [7.0] * 4, [7.0] * 4).tolist() == [1.0]
    assert polynomial(0) == ("1",)


@pytest.mark.parametrize("order", [-1, MAX_POWER + 1, 1.5, "2"])
def test_polynomial_order_out_of_range(order):
    with pytest.raises(ValueError, match="polynomial order") as caught:
        polynomial(order)
    assert repr(order) in str(caught.value)


@every(("name", "culprit"), [
    ("alpha", "'alpha'"), ("theta*gamma", "'gamma'"), ("2*theta", "'2'"), ("Theta", "'Theta'"), ("", "''"),
    ("theta*", "'theta*'"), ("theta**2", "'theta**2'"), ("theta^", "'theta^'"), ("theta^-1", "'theta^-1'"),
    ("theta^1.5", "'theta^1.5'"), ("tan(theta)", "'tan(theta)'"), ("sin(tau)", "'sin(tau)'"),
    ("sin(theta", "'sin(theta'"), ("sin(theta)^2", "'sin(theta)^2'"),
    ("sin(theta)*cos(beta)", "'sin(theta)*cos(beta)'"), ("theta^6", "'theta^6'"),
    ("theta^3*theta^3", "'theta^3*theta^3'")])
def test_bad_terms_are_named(name, culprit):
    with pytest.raises(ValueError, match="library term") as caught:
        parse_term(name)
    assert culprit in str(caught.value)
    with pytest.raises(ValueError, match="library") as caught:
        library_terms(("theta", name))
    assert culprit in str(caught.value)
    assert all(library in str(caught.value) for library in LIBRARIES)


@pytest.mark.parametrize(("library", "named"), [
    ("quadratik", "quadratik"), ("theta*beta, beta*theta", r"'theta\*beta' stands twice"), ((), "0 terms"),
    (polynomial(5)[:MAX_TERMS + 1], f"{MAX_TERMS + 1} terms")])
def test_what_is_no_library_is_named(library, named):
    assert len(library_terms(polynomial(5)[:MAX_TERMS])) == MAX_TERMS
    with pytest.raises(ValueError, match=named):
        library_terms(library)


def test_sign_of_zero_is_zero_and_no_function_is_one():
    sign = FUNCTIONS.index("sign")
    assert [function_value(sign, x) for x in (-2.0, -0.0, 0.0, 3.0)] == [-1.0, 0.0, 0.0, 1.0]
    assert function_value(0, 5.0) == 1.0


# ---------------------------------------------------------------- textbook numbers


def test_the_papers_ten_terms():
    """Navarro-Tapia et al., section 4.1."""
    assert polynomial(2) == ("1", "theta", "theta_dot", "beta", "theta^2", "theta*theta_dot", "theta*beta",
                             "theta_dot^2", "theta_dot*beta", "beta^2")
    assert LIBRARIES["quadratic"] == polynomial(2)


@pytest.mark.parametrize(("name", "allowed"), [
    ("rigid-body", [0, 0, 0, 0]), ("linear", [1, 1, 1, 0]), ("quadratic", [1, 1, 1, 0]),
    ("quadratic+sin", [1, 1, 1, 0]), ("lpv", [0, 0, 0, 0])])
def test_which_variables_of_the_named_libraries_are_centred(name, allowed):
    assert centred_variables(term_codes(library_terms(name))).tolist() == allowed


def test_no_term_of_a_library_inside_lpv_is_left_out():
    assert [default_own_share(library_terms(name)) for name in ("rigid-body", "lpv", "linear", "quadratic")] == [
        0.0, 0.0, 0.005**2, 0.005**2]
