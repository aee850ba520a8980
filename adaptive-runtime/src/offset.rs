//! What a strand carries beyond its guides, and how it returns: a critically damped spring per particle, in closed form.
//!
//! Contact leaves a strand away from where its guides would put it, and so does a change of guide set. Nothing but time acts on
//! such an offset while no solid is near, so it needs no stepping: its value at any moment follows from its last known
//! value, velocity and their age. A read evaluates it and leaves it as it is.

/// Particles at the root that carry no offset: they sit in the scalp.
pub(crate) const N_FIXED: usize = 2;

/// Factors of value and velocity after some time: `value = value_0 * a + velocity_0 * b`,
/// `velocity = value_0 * c + velocity_0 * d`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Return {
    a: f32,
    b: f32,
    c: f32,
    d: f32,
}

impl Return {
    /// Of a spring of angular frequency `rate` (1/s), damped critically, over `elapsed` s.
    pub(crate) fn over(elapsed: f64, rate: f64) -> Self {
        let fade = (-rate * elapsed).exp();
        Self {
            a: (fade * (1.0 + rate * elapsed)) as f32,
            b: (fade * elapsed) as f32,
            c: (-fade * rate * rate * elapsed) as f32,
            d: (fade * (1.0 - rate * elapsed)) as f32,
        }
    }

    /// The factors a, b, c, d.
    #[inline(always)]
    pub(crate) fn factors(&self) -> [f32; 4] {
        [self.a, self.b, self.c, self.d]
    }

    /// Value after that time.
    #[cfg(test)]
    pub(crate) fn value(&self, value: f32, velocity: f32) -> f32 {
        self.a * value + self.b * velocity
    }

    /// Velocity after that time.
    #[cfg(test)]
    pub(crate) fn velocity(&self, value: f32, velocity: f32) -> f32 {
        self.c * value + self.d * velocity
    }
}

/// The farthest an offset of at most `value` cm with a velocity of at most `velocity` cm/s will ever be, cm.
pub(crate) fn farthest(value: f32, velocity: f32, rate: f64) -> f32 {
    // The velocity's part t e^(-rt) is largest at t = 1/r.
    value + velocity / (rate * std::f64::consts::E).max(1e-6) as f32
}

/// The greatest speed that an offset of at most `value` cm with a velocity of at most `velocity` cm/s will ever have, cm/s.
pub(crate) fn fastest(value: f32, velocity: f32, rate: f64) -> f32 {
    velocity + value * (rate / std::f64::consts::E) as f32
}

/// Time after which an offset of at most `value` cm and `velocity` cm/s is below `least` cm for good, s.
pub(crate) fn fades_within(value: f32, velocity: f32, least: f64, rate: f64) -> f64 {
    let size = f64::from(value) + f64::from(velocity) / rate;
    if size <= least {
        return 0.0;
    }
    // (1 + x) e^-x stays below 2 e^(-x/2) for all x.
    2.0 * (2.0 * size / least).ln() / rate
}

/// The most that an offset can be of which [`fades_within`] said that it falls below `least` cm for good `remaining` s from now, cm.
pub(crate) fn most_that_fades_within(remaining: f64, least: f64, rate: f64) -> f64 {
    // It is below 2 size e^(-x/2) after x = rate * elapsed, and that falls to `least` then.
    least * (0.5 * rate * remaining).exp()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Rounding in single precision of values near one.
    const ROUND_OFF: f32 = 1e-5;

    #[test]
    fn two_short_times_are_one_long_one() {
        let whole = Return::over(0.3, 5.0);
        let (first, second) = (Return::over(0.1, 5.0), Return::over(0.2, 5.0));
        let (x, v) = (0.7, -2.0);
        let (y, w) = (first.value(x, v), first.velocity(x, v));
        assert!((second.value(y, w) - whole.value(x, v)).abs() < ROUND_OFF);
        assert!((second.velocity(y, w) - whole.velocity(x, v)).abs() < ROUND_OFF);
    }

    #[test]
    fn the_motion_obeys_a_critically_damped_spring() {
        let (rate, dt) = (5.0, 1e-3);
        let at = |t: f64| f64::from(Return::over(t, rate).value(0.5, 3.0));
        for k in 1..400 {
            let t = f64::from(k) * 2.0 * dt;
            let acceleration = (at(t + dt) - 2.0 * at(t) + at(t - dt)) / (dt * dt);
            let velocity = (at(t + dt) - at(t - dt)) / (2.0 * dt);
            let force = -rate * rate * at(t) - 2.0 * rate * velocity;
            // Differences of values held in single precision.
            assert!((acceleration - force).abs() < 0.3, "{acceleration} {force}");
        }
    }

    #[test]
    fn an_offset_is_never_farther_than_said_and_gone_when_said() {
        let rate = 5.0;
        for (x, v) in [(0.5, 0.0), (0.5, 8.0), (0.0, 20.0), (0.5, -20.0)] {
            let end = fades_within(f32::abs(x), f32::abs(v), 1e-4, rate);
            for k in 0..2000 {
                let t = f64::from(k) * 2e-3;
                let now = Return::over(t, rate).value(x, v).abs();
                assert!(now <= farthest(f32::abs(x), f32::abs(v), rate) + ROUND_OFF);
                let speed = Return::over(t, rate).velocity(x, v).abs();
                assert!(speed <= fastest(f32::abs(x), f32::abs(v), rate) + ROUND_OFF);
                assert!(t < end || now <= 1e-4);
                let most = most_that_fades_within(end - t, 1e-4, rate);
                assert!(f64::from(now) <= most + f64::from(ROUND_OFF), "{now} at {t} s of at most {most}");
            }
        }
    }
}
