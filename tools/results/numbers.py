"""How numbers are written in the pages of docs/results."""

import math


def fixed(value, decimals):
    """With so many decimals; what rounds to zero has no sign."""
    text = f"{value:.{decimals}f}"
    return text.lstrip("-") if float(text) == 0 else text.replace("-", "−")


def three_digits(value):
    """Three digits, two decimals at most: 0.73, 16.6, 100."""
    return fixed(value, 2 if value < 9.995 else 1 if value < 99.95 else 0)


def hundredths(value):
    """Two decimals, below 0.1 three."""
    return fixed(value, 3 if value < 0.0995 else 2)


def two_digits(value):
    """Two significant digits, below 0.01 one; below 5e-7 the result is 0. Examples: 21, 1.7, 0.25, 0.06, 0.0002."""
    if abs(value) < 5e-7:
        return "0"
    digits = 1 if abs(value) < 0.00995 else 2
    # rounding may carry into another digit: 0.0996 is 0.1
    exponent = math.floor(math.log10(abs(float(f"{value:.{digits - 1}e}"))))
    return fixed(value, max(0, digits - 1 - exponent))


def as_chosen(value):
    """As few digits as it takes: what somebody chose, as a limit."""
    return f"{value:.6g}"


def signed_percent(value):
    return ("+" if value > 0 else "") + fixed(value, 0 if abs(value) >= 0.95 else 1) + " %"


def span(low, high):
    """'0.25 to 0.30', and one number where both are the same."""
    return low if low == high else f"{low} to {high}"
