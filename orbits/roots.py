"""The root of a function of one variable. Our own, because importing a library's takes longer than what is solved."""

from collections.abc import Callable


def bracketed_root(
    function: Callable, a: float, b: float, fa: float, fb: float, enough: float = 0.0, width: float = 0.0
) -> float:
    """The root between a and b, where the function goes from fa to fb of opposite sign: bisection and secant (Dekker).

    Ends one secant step after a value of at most `enough`, with a bracket of a `width`, or at rounding.
    """
    if abs(fa) < abs(fb):
        a, b, fa, fb = b, a, fb, fa
    c, fc = a, fa  # a brackets with b, c is the previous b
    for _ in range(200):
        least = max(2.3e-16 * max(abs(a), abs(b)), 0.5 * width)
        if fb == 0 or abs(a - b) <= 2 * least:
            break
        middle = 0.5 * (a + b)
        new = b - fb * (b - c) / (fb - fc) if fb != fc else middle
        between = min(b, middle) < new < max(b, middle)
        if abs(fb) <= enough:
            return new if between else b
        new = new if between else middle
        if abs(new - b) < least:  # the secant has settled: step across the root, to close the bracket
            new = b + least if a > b else b - least
        c, fc = b, fb
        b, fb = new, function(new)
        if (fb > 0) == (fa > 0):
            a, fa = c, fc
        if abs(fa) < abs(fb):
            a, b, fa, fb = b, a, fb, fa
    return b
