"""An extended Kalman filter with the full covariance in 50 digits, by hand, for two driven wheels, to compare
the C with.

The errors of the wheels' angles are estimated together with the states, and derivatives are difference
quotients: nothing here has the structure of the generated filter.
"""

from collections.abc import Callable, Sequence

import mpmath as mp

STEP = mp.mpf(10) ** -25  # of difference quotients, in 50 digits
SCALES = ("thetadot_r", "thetadot_l", "b")


def vector(values: Sequence) -> mp.matrix:
    return mp.matrix([mp.mpf(float(value)) if not isinstance(value, mp.mpf) else value for value in values])


def derivative(function: Callable[[mp.matrix], mp.matrix], at: mp.matrix) -> mp.matrix:
    """The Jacobian, with an error of about 1e-25."""
    value = function(at)
    result = mp.matrix(len(value), len(at))
    for j in range(len(at)):
        moved = at.copy()
        moved[j] += STEP
        result[:, j] = (function(moved) - value) / STEP
    return result


class Reference:
    """States: x, y, heading of the point d ahead of the axle, bias of the gyro,
    and the scales of `scaled`, some of SCALES."""

    def __init__(
        self,
        r: float,
        b: float,
        d: float,
        noise,
        start,
        start_sd,
        gyro_noise,
        bias_sd,
        bias_walk,
        scale_sd=None,
    ):
        self.r, self.b, self.d = map(mp.mpf, (r, b, d))
        self.scaled = list(scale_sd or {})
        self.x = vector([*start, 0, *([1] * len(self.scaled))])
        self.P = mp.diag([mp.mpf(sd) ** 2 for sd in (*start_sd, bias_sd, *(scale_sd or {}).values())])
        self.noise, self.gyro_noise, self.walk = (
            [mp.mpf(v) for v in noise],
            mp.mpf(gyro_noise),
            mp.mpf(bias_walk),
        )

    def _rolled(self, x: mp.matrix, angles: mp.matrix) -> tuple[mp.mpf, mp.mpf]:
        """Distance and turn."""
        scale = dict.fromkeys(SCALES, mp.mpf(1)) | {name: x[4 + k] for k, name in enumerate(self.scaled)}
        right, left = self.r * scale["thetadot_r"] * angles[0], self.r * scale["thetadot_l"] * angles[1]
        return (right + left) / 2, (right - left) / (2 * self.b * scale["b"])

    def _moved(self, joint: mp.matrix, turned: mp.matrix) -> mp.matrix:
        """The states after the tick, from those before and the errors of the angles."""
        n = len(self.x)
        x = joint[:n]
        distance, turn = self._rolled(x, turned + joint[n:])
        middle = x[2] + turn / 2
        new = list(x)
        new[0] += distance * mp.cos(middle) - self.d * turn * mp.sin(middle)
        new[1] += distance * mp.sin(middle) + self.d * turn * mp.cos(middle)
        new[2] += turn
        return mp.matrix(new)

    def tick(self, turned, dt: float, gyro: float | None = None) -> None:
        """Estimate states and errors together, by the gyro; then move."""
        n, dt, turned = len(self.x), mp.mpf(dt), vector(turned)
        joint = mp.matrix([*self.x, 0, 0])
        P = mp.zeros(n + 2)
        P[:n, :n] = self.P
        for k in range(2):
            P[n + k, n + k] = self.noise[k] ** 2 * abs(turned[k])
        if gyro is not None:

            def seen(z: mp.matrix) -> mp.matrix:
                return mp.matrix([z[3] * dt + self._rolled(z[:n], turned + z[n:])[1]])

            H = derivative(seen, joint)
            S = (H * P * H.T)[0] + self.gyro_noise**2 * dt
            K = P * H.T / S
            joint = joint + K * (mp.mpf(gyro) * dt - seen(joint)[0])
            P = P - K * S * K.T
        F = derivative(lambda z: self._moved(z, turned), joint)
        self.x, self.P = self._moved(joint, turned), F * P * F.T
        self.P[3, 3] += self.walk**2 * dt

    def correct(
        self, kind: str, ahead=0.0, left=0.0, x=0.0, y=0.0, heading=0.0, range=0.0, sd=1.0, heading_sd=1.0
    ) -> mp.mpf:
        """Use a measurement; return its normalized innovation squared."""

        def seen(state: mp.matrix) -> mp.matrix:
            cosine, sine = mp.cos(state[2]), mp.sin(state[2])
            place = [state[0] + ahead * cosine - left * sine, state[1] + ahead * sine + left * cosine]
            rows = {
                "pose": [*place, state[2]],
                "position": place,
                "heading": [state[2]],
                "range": [mp.hypot(mp.mpf(x) - place[0], mp.mpf(y) - place[1])],
            }
            return mp.matrix(rows[kind])

        values, sds = {
            "pose": ([x, y, heading], [sd, sd, heading_sd]),
            "position": ([x, y], [sd, sd]),
            "heading": ([heading], [heading_sd]),
            "range": ([range], [sd]),
        }[kind]
        H = derivative(seen, self.x)
        S = H * self.P * H.T + mp.diag([mp.mpf(value) ** 2 for value in sds])
        innovation = vector(values) - seen(self.x)
        K = self.P * H.T * S**-1
        self.x, self.P = self.x + K * innovation, self.P - K * S * K.T
        return (innovation.T * S**-1 * innovation)[0]
