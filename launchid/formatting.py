"""Write numbers: for a reader to the digit that a standard deviation makes known, for JSON null if not finite."""

import math

DIGITS = 2          # of a standard deviation: more are not known
MOST_DECIMALS = 9   # a number closer to the noise of arithmetic is written with an exponent
NO_STD_DIGITS = 5   # of a value without one
SLOWEST_PERIOD = 0.5  # s: no launcher is logged as slowly, and milliseconds are above it
PLUS_MINUS = "+- is one standard deviation"   # everywhere; a 95 % interval is named, or written a..b


def json_number(x: float | None) -> float | None:
    """Return a number for JSON; None (null) if it is not finite, or None."""
    return float(x) if x is not None and math.isfinite(x) else None


def with_std(value: float | None, std: float | None) -> str:
    """Return `4.5 +- 1.6`: two digits of the standard deviation, the value to the last of them; "-" if unknown."""
    if value is None or not math.isfinite(value):
        return "-"
    if std is None or not math.isfinite(std) or std <= 0.0:
        return f"{value:.{NO_STD_DIGITS}g}"
    rounded, decimals = _last_digit(std)
    if not -MOST_DECIMALS <= decimals <= MOST_DECIMALS:
        return f"{value:.{NO_STD_DIGITS}g} +- {rounded:.{DIGITS - 1}e}"
    return f"{round(value, decimals):.{max(decimals, 0)}f} +- {rounded:.{max(decimals, 0)}f}"


def known(value: float, std: float) -> float:
    """Round a value to the last of two digits of its standard deviation, to NO_STD_DIGITS without one; never to 0
    unless it is 0."""
    if not (math.isfinite(std) and std > 0.0):
        return float(f"{value:.{NO_STD_DIGITS}g}")
    return round(value, _last_digit(std)[1]) or float(f"{value:.1g}")


def _last_digit(std: float) -> tuple[float, int]:
    """Return a standard deviation rounded to two digits, and the decimals of the last of them."""
    rounded = float(f"{std:.{DIGITS - 1}e}")  # 0.0996 is 0.10
    return rounded, DIGITS - 1 - math.floor(math.log10(rounded) + 1e-12)


def servo_lines(actuator: dict[str, dict[str, float | None]]) -> list[str]:
    """Return the estimated servo as one line, [] if it was not estimated; actuator: a JSON's natural_frequency [rad/s],
    damping_ratio, or time_constant [s], and delay [s], each with value and std."""
    if not any(each["std"] for each in actuator.values()):
        return []

    def of(name: str, unit: float = 1.0) -> str:
        return with_std(*(None if x is None else unit * x for x in (actuator[name]["value"], actuator[name]["std"])))

    how = f"{of('natural_frequency')} rad/s, damping ratio {of('damping_ratio')}" if "natural_frequency" in actuator \
        else f"time constant {of('time_constant', 1e3)} ms"
    return [f"servo as estimated: {how}, delay {of('delay', 1e3)} ms ({PLUS_MINUS})"]


def mode_lines(windows: list[dict[str, dict[str, float | None]]]) -> list[str]:
    """Return a line for each mode of slosh and bending as the last window that knows it has it; windows: a JSON's."""
    last: dict[str, dict[str, float | None]] = {}
    for modes in windows:
        last |= {name: each for name, each in modes.items() if each["frequency"] is not None}
    lines = []
    for name, each in last.items():
        size = "coupling" if "coupling" in each else "gain"
        numbers = [with_std(each[key], each[f"{key}_std"]) if each[f"{key}_std"] else f"{each[key]:.4g} (declared)"
                   for key in ("frequency", size)]
        lines.append(f"{name} as estimated: {numbers[0]} rad/s, {size} {numbers[1]}")
    return lines


def saying_what_plus_minus_is(lines: list[str]) -> list[str]:
    """Return the lines; the first that holds a `+-` also says that it is one standard deviation."""
    first = next((k for k, line in enumerate(lines) if " +- " in line), None)
    if first is None:
        return lines
    line = lines[first]
    said = f"{line[:-1]}; {PLUS_MINUS})" if line.endswith(")") else f"{line} ({PLUS_MINUS})"
    return [*lines[:first], said, *lines[first + 1:]]


def slow_hint(period: float) -> str:
    """Return a hint that a log's stamps are not in seconds if its period [s] is too long for a launcher; else ''."""
    if not period > SLOWEST_PERIOD:
        return ""
    unit, factor = ("milliseconds", 1e3) if period < SLOWEST_PERIOD * 1e3 else ("microseconds", 1e6)
    return f"; the log's step of {period:.4g} looks like {unit}: divide t by {factor:g}"
