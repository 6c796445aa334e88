"""Shared by the tests of certificates: hops in 30 digits, by Taylor steps."""

import mpmath

mpmath.mp.dps = 30


def series(start, b, R, M, length, h, order=36):
    """One 30-digit Taylor step of the hopper, force r + b r**3, gravity 1/(1 + z/R)**2 or, with R None, 1."""
    y1, v1, y2, v2 = ([value] for value in start)
    cube, square, r = [], [], []
    base, inverse, gravity = ([], []), ([], []), ([], [])

    def product(a, c, k):
        return mpmath.fsum(a[j] * c[k - j] for j in range(k + 1))

    for k in range(order):
        r.append(y1[k] - y2[k])
        square.append(product(r, r, k))
        cube.append(product(square, r, k))
        pull = []
        for i, height in enumerate((y1, y2)):
            if R is None:
                pull.append(mpmath.mpf(k == 0))
                continue
            base[i].append(height[k] / R + (k == 0) * (1 + (length / R if i == 0 else 0)))
            known = mpmath.fsum(base[i][j] * inverse[i][k - j] for j in range(1, k + 1))
            inverse[i].append(((k == 0) - known) / base[i][0])
            gravity[i].append(product(inverse[i], inverse[i], k))
            pull.append(gravity[i][k])
        force = r[k] + b * cube[k]
        y1.append(v1[k] / (k + 1))
        y2.append(v2[k] / (k + 1))
        v1.append(-(M * force + pull[0]) / (1 + M) / (k + 1))
        v2.append((force - pull[1]) / (1 + M) / (k + 1))
    return [mpmath.fsum(c * h**k for k, c in enumerate(row)) for row in (y1, v1, y2, v2)]


def exact_alpha(orbit, b, R, M, length):
    """The launch speed to 25 digits, by Newton's method on the half orbit from the double-precision answer."""
    b, M, length = mpmath.mpf(b), mpmath.mpf(M), mpmath.mpf(length)
    R = R and mpmath.mpf(R)
    rho = mpmath.findroot(lambda r: r + b * r**3 - 1, orbit.liftoff_extension)

    def middle(alpha, duration):
        state = [rho, alpha, mpmath.mpf(0), mpmath.mpf(0)]
        count = max(4, 2 * len(orbit.flight.times))
        for _ in range(count):
            state = series(state, b, R, M, length, duration / count)
        return mpmath.matrix([state[1], state[3]])

    u = mpmath.matrix([orbit.alpha, orbit.flight_time / 2])
    step, value = mpmath.mpf("1e-12"), middle(*u)
    slopes = [(middle(u[0] + step, u[1]) - value) / step, (middle(u[0], u[1] + step) - value) / step]
    jacobian = mpmath.matrix([[slope[i] for slope in slopes] for i in range(2)])
    u = u - mpmath.lu_solve(jacobian, value)
    return (u - mpmath.lu_solve(jacobian, middle(*u)))[0]  # the slopes are good to 12 digits, and so is each change
