//! Four rods of mechanics made of spring networks (MS08 §3.2), and what is read from them: a cantilever's tip, a swing's
//! period and decay, the twist at which a straight rod loses stability, a hanging coil's length.
//!
//! A network is clamped in the middle of its last wholly kinematic segment: the first spring that gives bends at the first
//! free hinge, and a hinge stands for the curvature from half a segment before it to half a segment after. Rods are laid out
//! so that their length counts from there; [`Clamp::AtRoot`] shows what it costs not to. Units: cm, g, s, dyn.

use nalgebra::{Isometry3, Vector2, Vector3};
use strand_sim::reference::PlainStrand;
use strand_sim::stiffness::{SpringConstants, calibrate_curly, calibrate_straight};
use strand_sim::{Drive, Error, Material, Scheme, StepInput, StepParams, StepWorkspace, StrandState};
use strand_sim::{StrandSystem, Substeps};

/// Bending stiffness of every rod here, dyn·cm².
pub const EI: f64 = 2.0;
/// Torsion stiffness, dyn·cm².
pub const GJ: f64 = 1.5;
/// Stretch stiffness, dyn.
pub const EA: f64 = 3e5;
/// Mass per length, g/cm.
pub const DENSITY: f64 = 5e-5;
/// Gravity, cm/s².
pub const GRAVITY: f64 = 981.0;

/// Where a rod's spring constants come from.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Springs {
    /// Such that the straight network has EI and GJ.
    Calibrated,
    /// EI and GJ taken for the constants at 1 cm.
    Naive,
}

/// Where a rod's length begins.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Clamp {
    /// In the middle of the last kinematic segment.
    MidSegment,
    /// At the first particle.
    AtRoot,
}

/// Material without any damping.
pub fn material(springs: Springs, h_cm: f64) -> Result<Material, Error> {
    let base = match springs {
        Springs::Calibrated => Material::of_fibre(EI, GJ, EA, h_cm)?,
        Springs::Naive => Material {
            stretch_dyn: EA,
            bend_dyn: EI,
            twist_dyn: GJ,
            altitude_dyn: strand_sim::ALTITUDE_PER_TWIST * GJ,
            ..Material::straight()
        },
    };
    Ok(undamped(base))
}

fn undamped(material: Material) -> Material {
    Material {
        stretch_damping: 0.0,
        bend_damping: 0.0,
        twist_damping: 0.0,
        altitude_damping: 0.0,
        air_drag_per_s: 0.0,
        linear_density_g_per_cm: DENSITY,
        ..material
    }
}

/// One strand on its way, strain limiting off.
pub struct Rod {
    pub system: StrandSystem,
    pub state: StrandState,
    pub params: StepParams,
    pub workspace: StepWorkspace,
}

impl Rod {
    pub fn new(points: &[Vector3<f64>], material: Material, gravity: f64, scheme: Scheme) -> Result<Self, Error> {
        let system = StrandSystem::new(points, points.len(), material)?;
        let params = StepParams {
            scheme,
            substeps: Substeps::Fixed(1),
            gravity: Vector3::z() * -gravity,
            strain_limit: 1e9,
            ..StepParams::standard()
        };
        let state = system.rest_state(&Isometry3::identity());
        Ok(Self { system, state, params, workspace: StepWorkspace::default() })
    }

    pub fn step(&mut self, dt: f64, forces: &[Vector3<f64>], drives: &[Drive]) {
        let input = StepInput { forces, drives, ..StepInput::still(dt, Isometry3::identity()) };
        self.system.step(&mut self.state, &input, &self.params, &mut self.workspace);
    }

    pub fn tip(&self) -> Vector3<f64> {
        let mut tip = Vector3::zeros();
        // The last particle read is the tip.
        self.system.read(&self.state, |_, _, x, _| tip = x);
        tip
    }
}

/// Points of a straight rod along `axis`, its clamp at the origin, and their spacing.
pub fn straight_rod(length: f64, n: usize, axis: Vector3<f64>, clamp: Clamp) -> (Vec<Vector3<f64>>, f64) {
    let behind = if clamp == Clamp::MidSegment { 0.5 } else { 0.0 };
    let h = length / (n as f64 - 1.0 - behind);
    ((0..n).map(|i| axis * (h * (i as f64 - behind))).collect(), h)
}

/// Steps until the tip of a rod comes to rest in thick air, at most `most_s` seconds.
fn settle(rod: &mut Rod, dt: f64, forces: &[Vector3<f64>], most_s: f64) {
    /// Speed of a tip at rest, cm/s: what is left to go is this over the slowest rate, some 10/s.
    const REST_CM_PER_S: f64 = 1e-6;
    let mut before = rod.tip();
    for k in 1..=(most_s / dt) as usize {
        rod.step(dt, forces, &[]);
        if k % 20 == 0 {
            let now = rod.tip();
            if (now - before).norm() < REST_CM_PER_S * 20.0 * dt {
                return;
            }
            before = now;
        }
    }
}

/// Tip (x, z) of a rod clamped level along x that hangs at rest.
pub fn cantilever_tip(length: f64, n: usize, springs: Springs, clamp: Clamp) -> Result<[f64; 2], Error> {
    let (points, h) = straight_rod(length, n, Vector3::x(), clamp);
    let first_mode = small_frequency(length);
    let material = Material { air_drag_per_s: 2.0 * first_mode, ..material(springs, h)? };
    let mut rod = Rod::new(&points, material, GRAVITY, Scheme::BackwardEuler)?;
    // Directions are frozen over a step: it stays below h/sqrt(g L).
    let dt = 0.5 * h / (GRAVITY * length).sqrt();
    settle(&mut rod, dt, &[], 60.0 / first_mode);
    Ok([rod.tip().x, rod.tip().z])
}

/// First angular frequency of a clamped thin rod, 1/s.
pub fn small_frequency(length: f64) -> f64 {
    3.516_015 * (EI / DENSITY).sqrt() / (length * length)
}

/// Period (s) and rate of decay of the amplitude (1/s) of a small swing in the first mode, without gravity.
pub fn small_swing(length: f64, n: usize, dt: f64, scheme: Scheme) -> Result<[f64; 2], Error> {
    const AMPLITUDE_CM: f64 = 0.01;
    const N_PERIODS: usize = 4;
    let (points, h) = straight_rod(length, n, Vector3::x(), Clamp::MidSegment);
    let mut rod = Rod::new(&points, material(Springs::Calibrated, h)?, 0.0, scheme)?;
    let shape = |s: f64| {
        let (b, sigma) = (1.875_104 * s / length, 0.734_096);
        0.5 * (b.cosh() - b.cos() - sigma * (b.sinh() - b.sin()))
    };
    let bent: Vec<_> = points
        .iter()
        .enumerate()
        .map(|(i, p)| p + Vector3::z() * if i < 2 { 0.0 } else { AMPLITUDE_CM * shape(p.x) })
        .collect();
    rod.state = rod.system.state_of_shape(&bent, &Isometry3::identity())?;
    let (mut before, mut falls, mut peaks, mut peak) = (rod.tip().z, Vec::new(), Vec::new(), 0.0_f64);
    for k in 1.. {
        rod.step(dt, &[], &[]);
        let now = rod.tip().z;
        if before > 0.0 && now <= 0.0 {
            falls.push(dt * (f64::from(k) - now / (now - before)));
            peaks.push(peak);
            peak = 0.0;
        }
        peak = peak.max(now);
        before = now;
        if falls.len() > N_PERIODS || f64::from(k) * dt > 2.0 * N_PERIODS as f64 * 6.3 / small_frequency(length) {
            break;
        }
    }
    if falls.len() <= N_PERIODS {
        return Ok([f64::NAN; 2]);
    }
    let span = falls[N_PERIODS] - falls[0];
    // The first peak is the start, in which higher modes stir; leave it out.
    let decay = (peaks[1] / peaks[N_PERIODS]).ln() / (span * (N_PERIODS - 1) as f64 / N_PERIODS as f64);
    Ok([span / N_PERIODS as f64, decay])
}

/// Tip (x, z) every `interval` seconds of a rod let go level.
pub fn released(
    length: f64,
    n: usize,
    dt: f64,
    scheme: Scheme,
    interval: f64,
    count: usize,
) -> Result<Vec<[f64; 2]>, Error> {
    let (points, h) = straight_rod(length, n, Vector3::x(), Clamp::MidSegment);
    let mut rod = Rod::new(&points, material(Springs::Calibrated, h)?, GRAVITY, scheme)?;
    let per_sample = (interval / dt).round() as usize;
    let mut out = vec![[rod.tip().x, rod.tip().z]];
    for _ in 1..count {
        for _ in 0..per_sample {
            rod.step(dt, &[], &[]);
        }
        out.push([rod.tip().x, rod.tip().z]);
    }
    Ok(out)
}

/// A straight rod of `length` along z, both ends clamped, the far one turned by `angle` about it and free to slide.
pub struct Twisted {
    rod: Rod,
    n: usize,
    length: f64,
    sense: f64,
    /// Force along z on the driven end at the last step, dyn.
    pub axial_dyn: f64,
    angle: f64,
    slide: f64,
}

impl Twisted {
    /// Stretch stiffness, dyn: softer than the other rods', so that the end soon finds where to slide. Stretch is still 2e-4.
    const EA: f64 = 2e4;
    /// Step, s.
    const DT: f64 = 1e-3;

    /// `sense` is 1 or -1.
    pub fn new(length: f64, n: usize, sense: f64) -> Result<Self, Error> {
        // Both clamps stand in the middle of a segment.
        let h = length / (n as f64 - 2.0);
        let points: Vec<_> = (0..n).map(|i| Vector3::z() * (h * (i as f64 - 0.5))).collect();
        // Thick air: what grows and what dies does so without swinging.
        let constants = calibrate_straight(EI, GJ, h, Self::EA, NO_ALTITUDE)?;
        let material = Material { air_drag_per_s: 60.0, ..undamped(constants.material(h, &Material::straight())) };
        Ok(Self {
            rod: Rod::new(&points, material, 0.0, Scheme::BackwardEuler)?,
            n,
            length,
            axial_dyn: 0.0,
            sense,
            angle: 0.0,
            slide: 0.0,
        })
    }

    /// Force along z of the springs on the driven end: negative where the rod pulls it in.
    fn read_axial(&self) -> f64 {
        let strand = PlainStrand::of(&self.rod.system, &self.rod.state, 0);
        let impulse = strand.right_side(1.0, Vector3::zeros());
        let (mass, velocity) = (strand.masses(), strand.velocities());
        // Two particles and the perturbed one between them.
        (impulse.len() - 3..impulse.len()).map(|p| impulse[p].z - mass[p] * velocity[p].z).sum()
    }

    fn pose(&self) -> Isometry3<f64> {
        Isometry3::new(Vector3::z() * self.slide, Vector3::zeros()) * turned(self.sense * self.angle)
    }

    /// One step with the end turned to `angle`, under a side force at the middle; the end slides to where nothing pulls it.
    fn step(&mut self, angle: f64, side_dyn: f64) {
        let mut forces = vec![Vector3::zeros(); self.n];
        forces[self.n / 2] = Vector3::x() * side_dyn;
        let from = self.pose();
        // A driven end cannot slide by itself: it is moved by what takes its axial force away. A rod pushed gives by bowing,
        // far more than it shortens when pulled.
        self.axial_dyn = self.read_axial();
        let compliance = self.length / Self::EA * if self.axial_dyn > 0.0 { 2.0 } else { 0.3 };
        self.slide += self.axial_dyn * compliance;
        self.angle = angle;
        let drive = [Drive { strand: 0, particles: (self.n - 2, self.n - 1), before: from, after: self.pose() }];
        self.rod.step(Self::DT, &forces, &drive);
    }

    /// Turns the end to `angle` at 4 rad/s and holds it for `hold_s`; where the middle is then, across the axis, cm.
    pub fn hold(&mut self, angle: f64, hold_s: f64, side_dyn: f64) -> Vector2<f64> {
        let per_step = 4.0 * Self::DT;
        while self.angle < angle {
            self.step((self.angle + per_step).min(angle), side_dyn);
        }
        for _ in 0..(hold_s / Self::DT) as usize {
            self.step(angle, side_dyn);
        }
        self.rod.system.positions(&self.rod.state)[self.n / 2].xy()
    }
}

/// Altitude springs over bending springs where there are to be none: their axial force is not read. A straight rig needs none.
const NO_ALTITUDE: f64 = 1e-9;

/// A turn about z. Beyond half a turn a pose alone does not say how it came there; steps do.
fn turned(angle: f64) -> Isometry3<f64> {
    Isometry3::rotation(Vector3::z() * angle)
}

/// Critical twist that theory gives two clamped ends, of which one slides (Greenhill), radians.
pub fn greenhill() -> f64 {
    8.986_82 * EI / GJ
}

/// Twist of the straight rod at which its side stiffness vanishes, and how far off the axis the middle was at the last twist
/// it was read at: stiffness at half to four fifths of theory's twist, even in it, carried on to zero. `sense` is 1 or -1:
/// perturbed particles wind one way, so a network is not its mirror image.
pub fn critical_twist(length: f64, n: usize, sense: f64) -> Result<[f64; 2], Error> {
    const SIDE_DYN: f64 = 1e-3;
    const HOLD_S: f64 = 2.0;
    let mut rod = Twisted::new(length, n, sense)?;
    let mut aside = 0.0;
    let squares = [0.5_f64, 0.65, 0.8].map(|f| f * f);
    // Twist alone bows a network a little: what counts is the difference that a force makes.
    let stiffness = squares.map(|square| {
        let angle = square.sqrt() * greenhill();
        let there = rod.hold(angle, HOLD_S, SIDE_DYN);
        let back = rod.hold(angle, HOLD_S, -SIDE_DYN);
        aside = there.norm();
        2.0 * SIDE_DYN / (there - back).norm()
    });
    // A parabola by divided differences, and its zero by Newton's method.
    let d01 = (stiffness[1] - stiffness[0]) / (squares[1] - squares[0]);
    let d12 = (stiffness[2] - stiffness[1]) / (squares[2] - squares[1]);
    let second = (d12 - d01) / (squares[2] - squares[0]);
    let at = |x: f64| stiffness[2] + (x - squares[2]) * (d12 + second * (x - squares[1]));
    let slope = |x: f64| d12 + second * (2.0 * x - squares[1] - squares[2]);
    let zero = (0..30).fold(1.0, |x, _| x - at(x) / slope(x));
    Ok([zero.sqrt() * greenhill(), aside])
}

/// The coil of the fixtures: radius, pitch (cm) and turns.
const COIL: (f64, f64, f64) = (0.5, 0.6, 6.0);

/// Altitude springs over torsion springs in a curly rig: it takes about five for positive constants to have both EI and GJ.
const ALTITUDE_PER_TWIST_OF_CURLS: f64 = 10.0;

/// How a coil's springs are found.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum CoilSprings {
    /// As a straight rod of the spacing.
    AsStraight,
    /// Such that the curly rig has EI against turn and GJ against twist; altitude springs carry the twist.
    AsCurl,
    /// EI and GJ taken for the constants at 1 cm.
    Naive,
}

/// A coil about -z of `per_turn` segments a turn.
pub struct Coil {
    pub points: Vec<Vector3<f64>>,
    pub h: f64,
    /// Turn and twist at every particle, radians.
    pub turn: f64,
    pub twist: f64,
    /// Whether its rig has perturbed particles.
    pub is_perturbed: bool,
}

impl Coil {
    /// The coil with its clamp at the top: half a segment from the first particle, or one and a half in the curly rig.
    pub fn new(per_turn: usize) -> Result<Self, Error> {
        let (radius, pitch, turns) = COIL;
        let tau = std::f64::consts::TAU;
        let at = |phase: f64| Vector3::new(radius * phase.cos(), radius * phase.sin(), -pitch * phase / tau);
        let n_segments = per_turn as f64 * turns;
        let layout = |behind: f64| -> Vec<Vector3<f64>> {
            let n = (n_segments + behind).round() as usize;
            let step = turns * tau / (n as f64 - behind);
            (0..=n).map(|i| at(step * (i as f64 - behind))).collect()
        };
        let curly = layout(1.5);
        let is_perturbed = StrandSystem::new(&curly, curly.len(), Material::straight())?.n_straight() > 0;
        let points = if is_perturbed { layout(0.5) } else { curly };
        let e = |i: usize| points[i + 1] - points[i];
        let (b0, b1) = (e(0).cross(&e(1)), e(1).cross(&e(2)));
        let turn = e(0).angle(&e(1));
        let twist = b0.angle(&b1) * b0.cross(&b1).dot(&e(1)).signum();
        Ok(Self { h: e(0).norm(), turn, twist, is_perturbed, points })
    }

    /// Material of the coil, or `None` where no positive constants are.
    pub fn material(&self, springs: CoilSprings) -> Option<Material> {
        match springs {
            CoilSprings::AsStraight => material(Springs::Calibrated, self.h).ok(),
            CoilSprings::Naive => material(Springs::Naive, self.h).ok(),
            CoilSprings::AsCurl => {
                let constants = self.curl_constants(ALTITUDE_PER_TWIST_OF_CURLS)?;
                Some(undamped(constants.material(self.h, &Material::straight())))
            }
        }
    }

    /// Constants of the curly rig that resist turn and twist with EI and GJ, altitude springs a share of torsion springs.
    pub fn curl_constants(&self, altitude_per_twist: f64) -> Option<SpringConstants> {
        calibrate_curly(EI, GJ, self.h, [self.turn, self.twist], EA, altitude_per_twist).ok()
    }

    /// Heights (cm) of the wire's end at rest under each load (dyn, downwards).
    pub fn heights(&self, material: &Material, gravity: f64, loads: &[f64]) -> Result<Vec<f64>, Error> {
        let thick = Material { air_drag_per_s: 40.0, ..*material };
        let mut rod = Rod::new(&self.points, thick, gravity, Scheme::BackwardEuler)?;
        let mut forces = vec![Vector3::zeros(); self.points.len()];
        let mut out = Vec::new();
        for load in loads {
            forces[self.points.len() - 1] = Vector3::z() * -load;
            settle(&mut rod, 1e-3, &forces, 4.0);
            out.push(rod.tip().z);
        }
        Ok(out)
    }
}
