"""Controllers as a control program writes them: one tick at a time, from the difference equations of textbooks."""

from maglev_env.loop.controller_forms import Cascade, Pid, StateFeedback
from maglev_env.loop.linear_controller import LinearController


def by_hand(controller, dt):
    """tick(reference, reading, current) -> command of a controller that is no plain PID gains; None for those."""
    kinds = {Pid: pid, StateFeedback: state_feedback, Cascade: cascade, LinearController: polynomials}
    made = kinds.get(type(controller))
    return made and made(controller, dt)


def clipped(u, limit):
    return u if limit is None else min(max(u, limit[0]), limit[1])


def pid(c, dt):
    s = {"wanted": 0.0, "integral": 0.0, "derivative": 0.0, "before": 0.0}

    def tick(reference, reading, current):
        s["wanted"] += dt / (c.setpoint_filter + dt) * (reference - s["wanted"])
        error = s["wanted"] - reading
        moved = error if c.derivative_on == "error" else -reading
        s["derivative"] = (c.td * s["derivative"] + c.kd * (moved - s["before"])) / (c.td + dt)
        s["before"] = moved
        s["integral"] += c.ki * error * dt
        rest = c.kp * (c.setpoint_weight * s["wanted"] - reading) + s["derivative"]
        u = clipped(rest + s["integral"], c.limit)
        if c.ki and c.anti_windup == "tracking":
            s["integral"] = u - rest
        return u

    return tick


def state_feedback(c, dt):
    s = {"wanted": 0.0, "integral": 0.0, "velocity": 0.0, "before": 0.0}

    def tick(reference, reading, current):
        s["wanted"] += dt / (c.setpoint_filter + dt) * (reference - s["wanted"])
        difference = (reading - s["before"]) / dt
        s["velocity"] += dt / (c.velocity_filter + dt) * (difference - s["velocity"])
        s["before"] = reading
        error = s["wanted"] - reading
        s["integral"] += c.integral * error * dt
        rest = c.displacement * error - c.velocity * s["velocity"] - c.current * current
        u = clipped(rest + s["integral"], c.limit)
        if c.integral and c.anti_windup == "tracking":
            s["integral"] = u - rest
        return u

    return tick


def cascade(c, dt):
    outer, s = pid(c.outer, dt), {"integral": 0.0}

    def tick(reference, reading, current):
        error = outer(reference, reading, current) - current
        s["integral"] += c.inner.ki * error * dt
        u = clipped((c.inner.kp * error + s["integral"]) / c.resistance, c.limit)
        if c.inner.ki and c.anti_windup == "tracking":
            s["integral"] = u * c.resistance - c.inner.kp * error
        return u

    return tick


def polynomials(c, dt):
    n = len(c.denominator)

    def whole(polynomial):
        return [0.0] * (n - len(polynomial)) + list(polynomial)

    a, of_reading, of_current = whole(c.denominator), whole(c.numerator), whole(c.current)
    of_reference = of_reading if c.reference is None else whole(c.reference)
    past = [(0.0, 0.0, 0.0, 0.0, 0.0)] * n  # reference, reading, current, command before and behind the limit

    def tick(reference, reading, current):
        past.insert(0, (reference, reading, current, 0.0, 0.0))
        past.pop()
        inputs = zip(of_reference, of_reading, of_current, past, strict=True)
        u = sum(b_r * p[0] - b_y * p[1] - b_i * p[2] for b_r, b_y, b_i, p in inputs)
        if c.anti_windup in ("tracking", "none"):
            seen = 4 if c.anti_windup == "tracking" else 3
            u -= sum(x * p[seen] for x, p in zip(a[1:], past[1:], strict=True))
        else:
            u -= sum(x * p[3] for x, p in zip(a[1:], past[1:], strict=True))
            u -= sum(x * (p[3] - p[4]) for x, p in zip(whole(c.anti_windup)[1:], past[1:], strict=True))
        past[0] = (reference, reading, current, u, clipped(u, c.limit))
        return past[0][4]

    return tick
