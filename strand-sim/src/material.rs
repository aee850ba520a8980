//! Constants of a hair fibre: AS16 Table 1, read in centimetre, gram, second.
//!
//! Bending and twisting springs are given at a reference particle spacing of 1 cm. A spring network's bending stiffness
//! goes as k·h², so the rig scales them by 1/h² and the same fibre bends alike at any resolution.

use crate::error::Error;

/// Spring, damping and contact constants of one kind of hair.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Material {
    /// Force of a stretch spring at strain one, dyn.
    pub stretch_dyn: f64,
    /// Force of a bend spring at strain one and 1 cm particle spacing, dyn.
    pub bend_dyn: f64,
    /// Force of a torsion spring at strain one and 1 cm particle spacing, dyn.
    pub twist_dyn: f64,
    /// Force of an altitude spring at strain one and 1 cm particle spacing, dyn; AS16 gives none.
    pub altitude_dyn: f64,
    /// Damping of stretch springs, dyn·s/cm.
    pub stretch_damping: f64,
    /// Damping of bend springs, dyn·s/cm.
    pub bend_damping: f64,
    /// Damping of torsion springs, dyn·s/cm.
    pub twist_damping: f64,
    /// Damping of altitude springs, dyn·s/cm.
    pub altitude_damping: f64,
    /// Coulomb friction coefficient of hair on a solid that names none of its own.
    pub friction: f64,
    /// Mass per length, g/cm.
    pub linear_density_g_per_cm: f64,
    /// Rate at which still air takes up a particle's velocity, 1/s.
    pub air_drag_per_s: f64,
}

/// Altitude springs as a share of torsion springs: what gives the network the GJ/EI of a round rod, 0.78 (MS08 and AS16 give
/// no constant). As strong as bend springs they would make EI six times as large.
pub const ALTITUDE_PER_TWIST: f64 = 0.2;

impl Material {
    /// AS16 Table 1, row "straight". Departure: the printed damping of 10 is kept for stretch only; on bend and torsion
    /// springs it would relax a bent hair over about a second.
    #[must_use]
    pub fn straight() -> Self {
        Self {
            stretch_dyn: 3e5,
            bend_dyn: 30.0,
            twist_dyn: 15.0,
            altitude_dyn: ALTITUDE_PER_TWIST * 15.0,
            stretch_damping: 10.0,
            bend_damping: 0.02,
            twist_damping: 0.02,
            altitude_damping: 0.02,
            friction: 0.05,
            linear_density_g_per_cm: 5e-5,
            air_drag_per_s: 1.0,
        }
    }

    /// AS16 Table 1, row "wavy"; damping as in [`Material::straight`].
    #[must_use]
    pub fn wavy() -> Self {
        Self {
            stretch_dyn: 2e6,
            bend_dyn: 200.0,
            twist_dyn: 100.0,
            altitude_dyn: ALTITUDE_PER_TWIST * 100.0,
            friction: 0.1,
            ..Self::straight()
        }
    }

    /// A curly preset that keeps its curls; not of AS16.
    ///
    /// A curl extends by about ρ g L² R²/(2 GJ), so what keeps it is stiffness: four times the wavy constants (EI of 91
    /// dyn·cm² in the straight rig, where a thick hair of 0.13 mm has as much). 25 cm of hair in curls of 0.5 to 1 cm
    /// radius then give up at most a tenth of what curling takes off their length: measured 1, 4 and 10 % at 0.5, 0.75
    /// and 1 cm, where wavy hair gives up a fifth and more of the last.
    ///
    /// These are not calibrated: with fewer than about twelve particles a turn a strand has no perturbed particles, and
    /// constants of a straight rod then leave a coil two to five times too soft ([`crate::stiffness::calibrate_curly`]).
    #[must_use]
    pub fn curly() -> Self {
        Self { bend_dyn: 800.0, twist_dyn: 400.0, altitude_dyn: ALTITUDE_PER_TWIST * 400.0, ..Self::wavy() }
    }

    /// Checks every constant.
    ///
    /// # Errors
    /// [`Error::BadMaterial`] names the first constant that is not finite or out of range.
    pub fn validate(&self) -> Result<(), Error> {
        let positive = [
            ("stretch_dyn", self.stretch_dyn),
            ("bend_dyn", self.bend_dyn),
            ("twist_dyn", self.twist_dyn),
            ("altitude_dyn", self.altitude_dyn),
            ("linear_density_g_per_cm", self.linear_density_g_per_cm),
        ];
        let non_negative = [
            ("stretch_damping", self.stretch_damping),
            ("bend_damping", self.bend_damping),
            ("twist_damping", self.twist_damping),
            ("altitude_damping", self.altitude_damping),
            ("friction", self.friction),
            ("air_drag_per_s", self.air_drag_per_s),
        ];
        for (name, value) in positive {
            if !(value.is_finite() && value > 0.0) {
                return Err(Error::BadMaterial { name, value, expected: "finite and greater than zero" });
            }
        }
        for (name, value) in non_negative {
            if !(value.is_finite() && value >= 0.0) {
                return Err(Error::BadMaterial { name, value, expected: "finite and not negative" });
            }
        }
        Ok(())
    }
}
