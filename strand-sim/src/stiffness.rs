//! Bending and torsion stiffness of the fibre that a spring network stands for (MS08 §3.2, Fig. 7).
//!
//! At rest every spring is a quadratic k/(2 l0) (A·u)² in small displacements u, A = w⊗d, so the network is a linear
//! structure. A straight rig is loaded by couples at its free ends: every section then carries the same moment, and
//! moment over curvature (twist) in the interior is EI (GJ), perturbed particles relaxed. A curly rig of constant turn and
//! twist has one particle a cell and nothing to relax: its stiffness is the second derivative of a cell's energy.

use crate::altitude::{AltitudeRest, altitude};
use crate::error::Error;
use crate::material::{ALTITUDE_PER_TWIST, Material};
use crate::rig::perturb::rig_particles;
use crate::rig::{Perturbed, SpringKind, Topology};
use nalgebra::{DMatrix, DVector, Vector3};

/// Segments of the strand measured on: end effects die out within a few of them.
const N_SEGMENTS: usize = 20;

/// Segments after which the straight rig repeats: four right angles.
const PERIOD: usize = 4;

/// Relative error at which a calibration is done; round-off of the solve is below 1e-7, since edges are 1e4 times stiffer.
const CALIBRATED: f64 = 1e-6;

/// Newton steps after which a calibration is given up; it needs about six.
const MAX_NEWTON_STEPS: usize = 40;

/// Step of the logarithm of a constant in Newton's derivative: its error is linear and only costs steps.
const LOG_DIFFERENCE: f64 = 1e-3;

/// Step of an angle in the curly rig's derivatives, radians.
const DIFFERENCE: f64 = 1e-5;

/// Largest change of a constant's logarithm in one Newton step.
const MAX_LOG_STEP: f64 = 1.0;

/// Spring constants of one network: forces at strain one, dyn, at the spacing they are used with.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SpringConstants {
    /// Edge springs, those to perturbed particles included.
    pub edge_dyn: f64,
    /// Bending springs.
    pub bend_dyn: f64,
    /// Torsion springs.
    pub twist_dyn: f64,
    /// Altitude springs on every four consecutive rig particles.
    pub altitude_dyn: f64,
}

/// What a strand resists, as a rod.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RodStiffness {
    /// EI in two planes at right angles, dyn·cm².
    pub bend: [f64; 2],
    /// GJ, dyn·cm².
    pub twist: f64,
}

/// Stiffness of a curly rig against changes of its turn and twist, dyn·cm².
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct CurlStiffness {
    /// Against change of curvature.
    pub bend: f64,
    /// Against change of torsion.
    pub twist: f64,
    /// Moment per change of torsion, and torque per change of curvature: zero in a rod of round section.
    pub coupling: f64,
}

impl RodStiffness {
    /// Mean EI of the two planes, dyn·cm².
    #[must_use]
    pub fn mean_bend(&self) -> f64 {
        f64::midpoint(self.bend[0], self.bend[1])
    }
}

/// EI and GJ of a straight strand of spacing `h_cm` in the rig of MS08 Fig. 7b.
///
/// # Errors
/// [`Error::SlackNetwork`] if the constants leave some motion without resistance.
pub fn straight_stiffness(h_cm: f64, constants: &SpringConstants) -> Result<RodStiffness, Error> {
    Structure::new(h_cm, constants, N_SEGMENTS)?.stiffness(N_SEGMENTS / 2)
}

/// Stiffness of a rig of MS08 Fig. 7a with `h_cm` between particles, bent by `turn` and twisted by `twist` radians at each,
/// edges inextensible. Constants of the straight rig make such a coil several times too soft; [`calibrate_curly`] finds others.
#[must_use]
pub fn curly_stiffness(h_cm: f64, turn: f64, twist: f64, constants: &SpringConstants) -> CurlStiffness {
    let cell = |turn: f64, twist: f64| -> [Vector3<f64>; 4] {
        let first = Vector3::new(turn.cos(), -turn.sin(), 0.0);
        let last = Vector3::new(turn.cos(), turn.sin() * twist.cos(), turn.sin() * twist.sin());
        [-first * h_cm, Vector3::zeros(), Vector3::x() * h_cm, (Vector3::x() + last) * h_cm]
    };
    let rest_shape = cell(turn, twist);
    let rest = AltitudeRest::new(&rest_shape);
    let lengths = |turn: f64, twist: f64| -> [f64; 2] {
        let x = cell(turn, twist);
        [(x[2] - x[0]).norm(), (x[3] - x[0]).norm()]
    };
    let slopes = |by: [f64; 2]| -> [f64; 3] {
        let [more, less] = [1.0, -1.0].map(|s| (turn + s * by[0] * DIFFERENCE, twist + s * by[1] * DIFFERENCE));
        let (m, l) = (lengths(more.0, more.1), lengths(less.0, less.1));
        let (xm, xl) = (cell(more.0, more.1), cell(less.0, less.1));
        // An altitude's gradient is w⊗d itself; differencing its length could cross to another candidate.
        let altitude_slope = altitude(&rest_shape, &rest)
            .map_or(0.0, |a| (0..4).map(|p| a.weight[p] * a.direction.dot(&(xm[p] - xl[p]))).sum::<f64>());
        [m[0] - l[0], m[1] - l[1], altitude_slope].map(|d| d / (2.0 * DIFFERENCE))
    };
    let (by_turn, by_twist) = (slopes([1.0, 0.0]), slopes([0.0, 1.0]));
    let [bend_length, twist_length] = lengths(turn, twist);
    let altitude_per_cm = altitude(&rest_shape, &rest).map_or(0.0, |a| constants.altitude_dyn * a.per_length);
    let per_cm = [constants.bend_dyn / bend_length, constants.twist_dyn / twist_length, altitude_per_cm];
    // Energy per length ½EI (dθ/h)² with one of each spring in a length h.
    let form = |a: [f64; 3], b: [f64; 3]| h_cm * (0..3).map(|k| per_cm[k] * a[k] * b[k]).sum::<f64>();
    CurlStiffness { bend: form(by_turn, by_turn), twist: form(by_twist, by_twist), coupling: form(by_turn, by_twist) }
}

/// Constants whose straight rig of spacing `h_cm` has the given `ei` and `gj` (dyn·cm²), for given edge springs and
/// altitude springs `altitude_per_bend` times as strong as bending springs. Newton's method on logarithms.
///
/// # Errors
/// [`Error::OutOfReach`] where no positive constants give that pair: torsion springs resist bending too (MS08 §7), so
/// GJ/EI has an upper bound.
pub fn calibrate_straight(
    ei: f64,
    gj: f64,
    h_cm: f64,
    edge_dyn: f64,
    altitude_per_bend: f64,
) -> Result<SpringConstants, Error> {
    check_positive(&[("ei", ei), ("gj", gj), ("h_cm", h_cm), ("edge_dyn", edge_dyn)])?;
    let constants = |log: [f64; 2]| SpringConstants {
        edge_dyn,
        bend_dyn: log[0].exp(),
        twist_dyn: log[1].exp(),
        altitude_dyn: altitude_per_bend * log[0].exp(),
    };
    let misses = |log: [f64; 2]| -> Result<[f64; 2], Error> {
        let s = straight_stiffness(h_cm, &constants(log))?;
        Ok([(s.mean_bend() / ei).ln(), (s.twist / gj).ln()])
    };
    let mut log = [(ei / (h_cm * h_cm)).ln(), (gj / (h_cm * h_cm)).ln()];
    for _ in 0..MAX_NEWTON_STEPS {
        let miss = misses(log)?;
        if miss[0].abs().max(miss[1].abs()) < CALIBRATED {
            return Ok(constants(log));
        }
        let a = misses([log[0] + LOG_DIFFERENCE, log[1]])?;
        let b = misses([log[0], log[1] + LOG_DIFFERENCE])?;
        let slope = |k: usize, at: &[f64; 2]| (at[k] - miss[k]) / LOG_DIFFERENCE;
        let determinant = slope(0, &a) * slope(1, &b) - slope(0, &b) * slope(1, &a);
        let step = [
            (slope(0, &b) * miss[1] - slope(1, &b) * miss[0]) / determinant,
            (slope(1, &a) * miss[0] - slope(0, &a) * miss[1]) / determinant,
        ];
        if !step.iter().all(|s| s.is_finite()) {
            break;
        }
        for k in 0..2 {
            log[k] += step[k].clamp(-MAX_LOG_STEP, MAX_LOG_STEP);
        }
    }
    Err(Error::OutOfReach { ei, gj, h_cm })
}

/// Constants whose curly rig of spacing `h_cm`, bent by `turn` and twisted by `twist` radians at each particle, resists changes of
/// its turn with `ei` and of its twist with `gj` (dyn·cm²); altitude springs `altitude_per_twist` times as strong as
/// torsion springs. Linear in the constants.
///
/// A rod couples neither to the other; here a coupling is left that three kinds of springs cannot take away, so that a coil
/// of 8 or 11 particles a turn stretches by up to 15 % too little, and up to 43 % too far under its own weight, where its
/// turns open; finer ones have the straight rig (docs/DEVIATIONS.md).
///
/// # Errors
/// [`Error::BadMaterial`] for an argument that is not positive, [`Error::OutOfReach`] where no positive constants give that
/// pair: at 8 to 11 particles a turn altitude springs need to be some five times the torsion springs.
pub fn calibrate_curly(
    ei: f64,
    gj: f64,
    h_cm: f64,
    [turn, twist]: [f64; 2],
    edge_dyn: f64,
    altitude_per_twist: f64,
) -> Result<SpringConstants, Error> {
    check_positive(&[("ei", ei), ("gj", gj), ("h_cm", h_cm), ("edge_dyn", edge_dyn)])?;
    let constants = |bend_dyn: f64, twist_dyn: f64| SpringConstants {
        edge_dyn,
        bend_dyn,
        twist_dyn,
        altitude_dyn: altitude_per_twist * twist_dyn,
    };
    let of = |bend_dyn: f64, twist_dyn: f64| curly_stiffness(h_cm, turn, twist, &constants(bend_dyn, twist_dyn));
    let (b, t) = (of(1.0, 0.0), of(0.0, 1.0));
    let determinant = b.bend * t.twist - b.twist * t.bend;
    let bend_dyn = (ei * t.twist - gj * t.bend) / determinant;
    let twist_dyn = (b.bend * gj - b.twist * ei) / determinant;
    // Not a number fails the comparisons too.
    if bend_dyn > 0.0 && twist_dyn > 0.0 {
        Ok(constants(bend_dyn, twist_dyn))
    } else {
        Err(Error::OutOfReach { ei, gj, h_cm })
    }
}

fn check_positive(values: &[(&'static str, f64)]) -> Result<(), Error> {
    for &(name, value) in values {
        if !(value.is_finite() && value > 0.0) {
            return Err(Error::BadMaterial { name, value, expected: "finite and greater than zero" });
        }
    }
    Ok(())
}

/// Altitude springs over bending springs in a calibrated material: [`ALTITUDE_PER_TWIST`] at the one twist spring to two bend
/// springs of AS16 Table 1.
const ALTITUDE_PER_BEND: f64 = 0.5 * ALTITUDE_PER_TWIST;

impl SpringConstants {
    /// These springs as a material whose rig of spacing `h_cm` has them; all that is not a spring is as in `rest`.
    #[must_use]
    pub fn material(&self, h_cm: f64, rest: &Material) -> Material {
        // A material is written at 1 cm: the rig divides by h² all but the edges.
        let at_one_cm = h_cm * h_cm;
        Material {
            stretch_dyn: self.edge_dyn,
            bend_dyn: self.bend_dyn * at_one_cm,
            twist_dyn: self.twist_dyn * at_one_cm,
            altitude_dyn: self.altitude_dyn * at_one_cm,
            ..*rest
        }
    }
}

impl Material {
    /// Hair whose straight rig of spacing `h_cm` has the bending stiffness `ei` and torsion stiffness `gj` (dyn·cm²), and
    /// edge springs of `ea` dyn; damping, friction, mass and drag are those of [`Material::straight`].
    ///
    /// # Errors
    /// As [`calibrate_straight`].
    pub fn of_fibre(ei: f64, gj: f64, ea: f64, h_cm: f64) -> Result<Self, Error> {
        Ok(calibrate_straight(ei, gj, h_cm, ea, ALTITUDE_PER_BEND)?.material(h_cm, &Self::straight()))
    }
}

/// A free straight strand as a linear structure, held where couples at its ends cause no reaction.
struct Structure {
    h_cm: f64,
    n_segments: usize,
    rig: Vec<Vector3<f64>>,
    /// Free coordinates, in the order of the matrix.
    free: Vec<usize>,
    factor: nalgebra::Cholesky<f64, nalgebra::Dyn>,
}

impl Structure {
    fn new(h_cm: f64, constants: &SpringConstants, n_segments: usize) -> Result<Self, Error> {
        let topology = Topology::new(&Perturbed::everywhere(n_segments + 1));
        let points: Vec<_> = (0..=n_segments).map(|i| Vector3::z() * (h_cm * i as f64)).collect();
        let rig = rig_particles(&topology, &points);
        let mut hessian = DMatrix::zeros(3 * rig.len(), 3 * rig.len());
        let mut add = |corners: &[usize], weight: &[f64], direction: Vector3<f64>, per_cm: f64| {
            for (&p, wp) in corners.iter().zip(weight) {
                for (&q, wq) in corners.iter().zip(weight) {
                    let block = direction * direction.transpose() * (per_cm * wp * wq);
                    let mut view = hessian.fixed_view_mut::<3, 3>(3 * p, 3 * q);
                    view += block;
                }
            }
        };
        for spring in &topology.springs {
            let edge = rig[spring.b] - rig[spring.a];
            let k = match spring.kind {
                SpringKind::Edge => constants.edge_dyn,
                SpringKind::Bend => constants.bend_dyn,
                SpringKind::Torsion => constants.twist_dyn,
            };
            add(&[spring.a, spring.b], &[-1.0, 1.0], edge.normalize(), k / edge.norm());
        }
        for first in 0..rig.len() - 3 {
            let corners = [first, first + 1, first + 2, first + 3];
            let x = corners.map(|c| rig[c]);
            if let Some(a) = altitude(&x, &AltitudeRest::new(&x)) {
                add(&corners, &a.weight, a.direction, constants.altitude_dyn * a.per_length);
            }
        }
        // Six coordinates: one end, the other end's sides, and the turn of the first perturbed particle.
        let last = 3 * (rig.len() - 1);
        let aside = Vector3::z().cross(&(rig[1] - rig[0]));
        let held = [0, 1, 2, last, last + 1, 3 + usize::from(aside.y.abs() > aside.x.abs())];
        let free: Vec<usize> = (0..3 * rig.len()).filter(|i| !held.contains(i)).collect();
        let reduced = DMatrix::from_fn(free.len(), free.len(), |i, j| hessian[(free[i], free[j])]);
        let factor = reduced.cholesky().ok_or(Error::SlackNetwork { h_cm })?;
        Ok(Self { h_cm, n_segments, rig, free, factor })
    }

    /// Displacement of every rig particle under self-balanced forces.
    fn solve(&self, forces: &[(usize, Vector3<f64>)]) -> Vec<Vector3<f64>> {
        let mut load = DVector::zeros(3 * self.rig.len());
        for (p, f) in forces {
            for k in 0..3 {
                load[3 * p + k] += f[k];
            }
        }
        let reduced = DVector::from_fn(self.free.len(), |i, _| load[self.free[i]]);
        let solved = self.factor.solve(&reduced);
        let mut out = vec![Vector3::zeros(); self.rig.len()];
        for (value, &i) in solved.iter().zip(&self.free) {
            out[i / 3][i % 3] = *value;
        }
        out
    }

    /// EI and GJ read over one period either side of segment `at`.
    fn stiffness(&self, at: usize) -> Result<RodStiffness, Error> {
        let main = |i: usize| 2 * i;
        let n = self.n_segments;
        let span = PERIOD as f64 * self.h_cm;
        let bend = [Vector3::x(), Vector3::y()].map(|side| {
            // Unit moments: forces 1/h apart by h.
            let f = side / self.h_cm;
            let u = self.solve(&[(main(0), f), (main(1), -f), (main(n - 1), -f), (main(n), f)]);
            let [below, here, above] = [at - PERIOD, at, at + PERIOD].map(|i| u[main(i)].dot(&side));
            span * span / (above - 2.0 * here + below).abs()
        });
        let arm = |j: usize| self.rig[main(j) + 1] - (self.rig[main(j)] + self.rig[main(j) + 2]) / 2.0;
        let tangent = |j: usize| Vector3::z().cross(&arm(j)) / arm(j).norm_squared();
        let mut load = Vec::new();
        for (j, sign) in [(0, -1.0), (n - 1, 1.0)] {
            // Force times arm is one: |tangent| is the reciprocal of the arm's length.
            let f = tangent(j) * sign;
            load.extend([(main(j) + 1, f), (main(j), -f / 2.0), (main(j) + 2, -f / 2.0)]);
        }
        let u = self.solve(&load);
        let angle = |j: usize| (u[main(j) + 1] - (u[main(j)] + u[main(j) + 2]) / 2.0).dot(&tangent(j));
        let twist = 2.0 * span / (angle(at + PERIOD) - angle(at - PERIOD)).abs();
        let found = RodStiffness { bend, twist };
        if found.bend.iter().chain([&found.twist]).all(|v| v.is_finite() && *v > 0.0) {
            Ok(found)
        } else {
            Err(Error::SlackNetwork { h_cm: self.h_cm })
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const STRAIGHT: SpringConstants =
        SpringConstants { edge_dyn: 3e5, bend_dyn: 30.0, twist_dyn: 15.0, altitude_dyn: 30.0 };

    /// Round-off of a solve whose edges are 1e4 times stiffer than its bending springs, over some hundred coordinates.
    const SOLVER_ROUND_OFF: f64 = 1e-6;
    /// Central differences with a step of 1e-5 rad.
    const DIFFERENCE_ERROR: f64 = 1e-8;

    fn measured(h_cm: f64, constants: &SpringConstants) -> RodStiffness {
        straight_stiffness(h_cm, constants).expect("every constant is positive")
    }

    fn agree(a: &RodStiffness, b: &RodStiffness, factor: f64) -> bool {
        let near = |x: f64, y: f64| (x * factor / y - 1.0).abs() < SOLVER_ROUND_OFF;
        near(a.bend[0], b.bend[0]) && near(a.bend[1], b.bend[1]) && near(a.twist, b.twist)
    }

    #[test]
    fn stiffness_is_proportional_to_the_constants_together() {
        let SpringConstants { edge_dyn, bend_dyn, twist_dyn, altitude_dyn } = STRAIGHT;
        let thrice = SpringConstants {
            edge_dyn: 3.0 * edge_dyn,
            bend_dyn: 3.0 * bend_dyn,
            twist_dyn: 3.0 * twist_dyn,
            altitude_dyn: 3.0 * altitude_dyn,
        };
        assert!(agree(&measured(1.0, &STRAIGHT), &measured(1.0, &thrice), 3.0));
    }

    #[test]
    fn stiffness_goes_as_the_square_of_the_spacing() {
        let coarse = measured(1.0, &STRAIGHT);
        for h_cm in [0.25, 0.5, 2.0] {
            assert!(agree(&coarse, &measured(h_cm, &STRAIGHT), h_cm * h_cm));
        }
    }

    #[test]
    fn a_quarter_turn_between_perturbed_particles_bends_alike_in_both_planes() {
        for altitude_dyn in [0.0, 3.0, 30.0, 300.0] {
            let s = measured(1.0, &SpringConstants { altitude_dyn, ..STRAIGHT });
            assert!((s.bend[0] / s.bend[1] - 1.0).abs() < SOLVER_ROUND_OFF);
        }
    }

    #[test]
    fn stiffness_does_not_depend_on_where_it_is_measured() {
        let structure = Structure::new(1.0, &STRAIGHT, N_SEGMENTS).expect("every constant is positive");
        let middle = structure.stiffness(N_SEGMENTS / 2).expect("loads have answers");
        for at in [7, 8, 9, 12, 13] {
            assert!(agree(&middle, &structure.stiffness(at).expect("loads have answers"), 1.0));
        }
    }

    #[test]
    fn every_kind_of_spring_stiffens_bending_and_twist() {
        let base = measured(1.0, &STRAIGHT);
        for more in [
            SpringConstants { bend_dyn: 60.0, ..STRAIGHT },
            SpringConstants { twist_dyn: 30.0, ..STRAIGHT },
            SpringConstants { altitude_dyn: 60.0, ..STRAIGHT },
        ] {
            let stiffer = measured(1.0, &more);
            assert!(stiffer.mean_bend() > base.mean_bend() && stiffer.twist > base.twist);
        }
    }

    #[test]
    fn calibrated_constants_have_the_stiffness_asked_for() {
        // EI and GJ of hair are some 2 to 10 dyn·cm²; h as of 25 and 50 particles on 25 cm.
        for (ei, gj, h_cm) in [(2.0, 0.8, 1.0), (9.0, 2.0, 1.0), (10.0, 3.0, 1.0), (2.0, 0.8, 0.5)] {
            let found = calibrate_straight(ei, gj, h_cm, 3e5, 1.0).expect("within reach");
            let s = measured(h_cm, &found);
            assert!(
                (s.mean_bend() / ei - 1.0).abs() < 2.0 * CALIBRATED && (s.twist / gj - 1.0).abs() < 2.0 * CALIBRATED
            );
        }
        assert!(matches!(calibrate_straight(10.0, 30.0, 1.0, 3e5, 1.0), Err(Error::OutOfReach { .. })));
        assert!(matches!(calibrate_straight(-1.0, 3.0, 1.0, 3e5, 1.0), Err(Error::BadMaterial { name: "ei", .. })));
    }

    #[test]
    fn a_material_of_a_fibre_has_its_stiffness_at_its_spacing() {
        for h_cm in [0.1, 0.4, 1.0] {
            let m = Material::of_fibre(2.0, 1.5, 3e5, h_cm).expect("within reach");
            let constants = SpringConstants {
                edge_dyn: SpringKind::Edge.constants(&m, h_cm).0,
                bend_dyn: SpringKind::Bend.constants(&m, h_cm).0,
                twist_dyn: SpringKind::Torsion.constants(&m, h_cm).0,
                altitude_dyn: crate::rig::altitude_constants(&m, h_cm).0,
            };
            let s = measured(h_cm, &constants);
            assert!(
                (s.mean_bend() / 2.0 - 1.0).abs() < 2.0 * CALIBRATED && (s.twist / 1.5 - 1.0).abs() < 2.0 * CALIBRATED
            );
        }
    }

    #[test]
    fn calibrated_curls_have_the_stiffness_asked_for() {
        // Coils of 8 and 11 particles a turn.
        for (turn, twist) in [(0.76, 0.14), (0.56, 0.11)] {
            let found = calibrate_curly(2.0, 1.5, 0.4, [turn, twist], 3e5, 10.0).expect("within reach");
            let s = curly_stiffness(0.4, turn, twist, &found);
            assert!((s.bend / 2.0 - 1.0).abs() < DIFFERENCE_ERROR && (s.twist / 1.5 - 1.0).abs() < DIFFERENCE_ERROR);
            let weak = calibrate_curly(2.0, 1.5, 0.4, [turn, twist], 3e5, ALTITUDE_PER_TWIST);
            assert!(matches!(weak, Err(Error::OutOfReach { .. })));
        }
        assert!(matches!(
            calibrate_curly(2.0, 0.0, 0.4, [0.7, 0.1], 3e5, 10.0),
            Err(Error::BadMaterial { name: "gj", .. })
        ));
    }

    #[test]
    fn a_flat_curl_resists_twist_by_its_altitude_springs_alone() {
        let without = SpringConstants { altitude_dyn: 0.0, ..STRAIGHT };
        assert!(curly_stiffness(1.0, 0.6, 0.0, &without).twist < DIFFERENCE_ERROR);
        let with = curly_stiffness(1.0, 0.6, 0.0, &STRAIGHT);
        assert!(with.twist > 1.0 && with.coupling.abs() < DIFFERENCE_ERROR);
        // A straight line has neither: hence the perturbed particles.
        let line = curly_stiffness(1.0, 0.0, 0.0, &STRAIGHT);
        assert!(line.bend < DIFFERENCE_ERROR && line.twist < DIFFERENCE_ERROR);
    }

    #[test]
    fn a_curls_stiffness_is_a_positive_form_and_goes_as_the_square_of_the_spacing() {
        for (turn, twist) in [(0.3, 0.1), (0.6, 0.4), (1.0, -0.7)] {
            let one = curly_stiffness(1.0, turn, twist, &STRAIGHT);
            assert!(one.bend * one.twist > one.coupling * one.coupling);
            let half = curly_stiffness(0.5, turn, twist, &STRAIGHT);
            for (a, b) in [(one.bend, half.bend), (one.twist, half.twist), (one.coupling, half.coupling)] {
                assert!((b / a - 0.25).abs() < DIFFERENCE_ERROR);
            }
        }
    }
}
