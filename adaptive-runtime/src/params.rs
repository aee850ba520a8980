//! How the runtime chooses sets and corrects contact: named presets, every field public.

use crate::error::Error;
use crate::hair_hair::HairHairParams;
use strand_sim::{InteractionParams, StepParams};

/// How guides are moved.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum GuideIntegrator {
    /// As mass-spring strands (MS08 §4).
    Springs,
    /// By dynamic follow-the-leader, that AS16 §7.2 compares with: a cheap baseline without bending or twist.
    FollowTheLeader(DftlParams),
}

/// Constants of dynamic follow-the-leader (Müller et al. 2012).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct DftlParams {
    /// Share, 0 to 1, of the correction of the next particle that a particle's velocity is put right by.
    pub correction: f64,
    /// Rate at which velocity relative to the head dies away, 1/s.
    pub drag_per_s: f64,
}

impl DftlParams {
    /// The paper's share of nine tenths; a drag that brings hair to rest in about a second.
    #[must_use]
    pub fn standard() -> Self {
        Self { correction: 0.9, drag_per_s: 2.0 }
    }
}

/// Choice of guide sets (AS16 §4.3).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct AssignParams {
    /// Whether sets follow the guide graph at all; if not, each hair keeps its best-trained set (fixed skinning).
    pub adapt: bool,
    /// Among candidates whose cost (AS16 Eq. 3, as RMS shift of the strand, cm) is within this of the least, the one that
    /// trained best is taken.
    pub cost_tolerance_cm: f32,
    /// A set whose guides were parted is left only for one that is nearer by more than this to where solids hold the hair (RMS, cm): while
    /// the hair is where its guides put it, leaving gains nothing. Negative leaves it at once, as AS16 Algorithm 1 to the letter; so
    /// does any correction but [`Correction::Carried`], for without it nothing tells where a hair is held.
    pub leave_gain_cm: f32,
    /// A set still inside a clique may be left for a better-trained one that moves the strand by at most this (RMS, cm);
    /// negative never leaves it, as AS16 Eq. (3) to the letter.
    pub growth_tolerance_cm: f32,
    /// Choices between a strand's attempts to grow back; strands take turns.
    pub growth_period: u32,
    /// Steps between choices: edges are decided in one, and hairs choose half as many steps later.
    pub steps_per_choice: u32,
    /// Whether edges need similar motion (AS16 §4.1), as `edge_distance` measures it.
    pub similarity: bool,
    /// What two guides must be near in.
    pub edge_distance: EdgeDistance,
    /// Whether edges need a gap free of solids (AS16 §4.2).
    pub avoidance: bool,
    /// In what cliques a hair's set must be.
    pub cliques: CliqueRule,
    /// Where weights come from.
    pub weights: WeightRule,
}

/// How far apart two guides are that may share an edge.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum EdgeDistance {
    /// AS16 Eq. (2) with the model's calibrated thresholds.
    Motion,
    /// Distance of the guides' tips, below a threshold: Bertails et al. 2006 as AS16 §7.2 describes it, to compare with.
    Tips {
        /// Threshold, cm.
        d_max_cm: f32,
    },
}

/// Cliques a hair's guides are taken from.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum CliqueRule {
    /// All cliques of the graph among the hair's own eligible guides: at most nine, so they are found exactly.
    Local,
    /// The hair's share of the cliques grown greedily around each guide, and every kept set within one: AS16 Algorithm 1 to the
    /// letter.
    Grown,
}

/// Weights of the guides of a set.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum WeightRule {
    /// The model's polynomials.
    Trained,
    /// Reciprocal distances (AS16 Eq. 11), to compare with; see `assign/distance_weights.rs`.
    Distance,
}

/// How the effective forces on guides are found (AS16 Eq. 4).
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum TwoWaySolve {
    /// Exactly, from rows built anew at each step: the reference, and much the slower.
    LeastSquares,
    /// By a fixed number of conjugate-gradient steps from the last step's answer, on a matrix kept from step to step.
    ConjugateGradients {
        /// Steps taken.
        iterations: u32,
    },
}

/// Effective forces of normal hairs on guides (AS16 §5.2).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TwoWayParams {
    /// Whether normal hairs push back on their guides.
    pub enabled: bool,
    /// How they are found.
    pub solve: TwoWaySolve,
    /// Penalty stiffness on normal hairs as a multiple of a particle's m/dt². The force acts one step late and explicitly,
    /// so from about one on guides oscillate.
    pub stiffness_over_inertia: f64,
    /// Weight of a row of AS16 Eq. (4) whose hair is out of contact; one is the letter, which dilutes the forces by the
    /// share of hairs in contact.
    pub idle_row_weight: f64,
    /// Ridge on the diagonal as a fraction of its mean: guides no hair depends on get no force.
    pub ridge: f64,
    /// Share of the last step's forces that is kept, 0 to 1: smooths the one-step lag between hair and guide.
    pub memory: f64,
    /// Largest force on a guide particle, as an acceleration, cm/s².
    pub max_acceleration: f64,
}

/// What is done for a strand that its guides lead into a solid.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Correction {
    /// Nothing: it goes through (AS16 to the letter, which trusts to sets and two-way forces).
    None,
    /// Its particles are moved out one by one at the end of a step, and the next step knows nothing of it (Chai 2014).
    Position,
    /// It is held off by an offset carried from step to step.
    Carried,
}

/// Residual correction of single strands.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ResidualParams {
    /// How strands near solids are corrected.
    pub correction: Correction,
    /// Rate at which an offset that nothing holds returns if hair is straight, damped critically, 1/s; that of stiffer hair is larger by the root of its
    /// bending stiffness.
    pub return_rate: f64,
    /// Most substeps a step is divided into for a strand near a moving solid.
    pub max_substeps: usize,
    /// Relative motion of strand and solid per substep, as a multiple of the solid's least half-thickness.
    pub motion_per_substep: f64,
    /// Most steps that strands near a solid go between being met: fewer where they would move by more than `motion_per_meeting`. A power of
    /// two, at most [`MAX_STEPS_PER_MEETING`].
    pub steps_per_meeting: usize,
    /// Relative motion of strand and solid between meetings several steps apart, as a multiple of the solid's least half-thickness.
    pub motion_per_meeting: f64,
    /// Largest speed of an offset, cm/s.
    pub max_speed: f64,
    /// Offsets that stay below this are dropped, cm.
    pub rest_cm: f64,
}

/// Most steps that strands may go between being met with solids.
pub const MAX_STEPS_PER_MEETING: usize = 4;

/// All parameters of a runtime.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RuntimeParams {
    /// Guides' integration.
    pub guides: StepParams,
    /// What moves the guides; of [`Self::guides`] follow-the-leader takes gravity and the contact offset.
    pub guide_integrator: GuideIntegrator,
    /// How guides meet each other (AS16 §7.1); `None` lets them pass. Springs only.
    pub guide_interaction: Option<InteractionParams>,
    /// Choice of sets.
    pub assign: AssignParams,
    /// Two-way correction.
    pub two_way: TwoWayParams,
    /// Residual correction.
    pub residual: ResidualParams,
    /// Hair-hair correction of what is read; off in every preset, since a read then costs several times as much.
    pub hair_hair: HairHairParams,
    /// Resolution of the interpolation check, as a multiple of a solid's least half-thickness.
    pub gap_resolution: f32,
    /// Steps between full interpolation checks of a pair that is neither surely free nor surely blocked, pairs taking turns: one decides
    /// every pair in every step.
    pub gap_period: u32,
}

/// [`StepParams::standard`], each substep solved once: what tears loose is slowed from the next on.
fn guide_step() -> StepParams {
    let mut step = StepParams::standard();
    step.contact.solve_torn_again = false;
    step
}

impl RuntimeParams {
    /// The whole method with the departures of docs/DEVIATIONS.md.
    #[must_use]
    pub fn adaptive() -> Self {
        Self {
            guides: guide_step(),
            guide_integrator: GuideIntegrator::Springs,
            guide_interaction: None,
            assign: AssignParams {
                adapt: true,
                cost_tolerance_cm: 0.05,
                leave_gain_cm: 0.5,
                growth_tolerance_cm: 0.5,
                growth_period: 4,
                steps_per_choice: 2,
                similarity: true,
                avoidance: true,
                edge_distance: EdgeDistance::Motion,
                cliques: CliqueRule::Local,
                weights: WeightRule::Trained,
            },
            two_way: TwoWayParams {
                enabled: true,
                solve: TwoWaySolve::ConjugateGradients { iterations: 6 },
                stiffness_over_inertia: 0.03,
                idle_row_weight: 0.05,
                ridge: 1e-3,
                memory: 0.8,
                max_acceleration: 2e3,
            },
            residual: ResidualParams {
                correction: Correction::Carried,
                return_rate: 5.0,
                max_substeps: 8,
                motion_per_substep: 2.0,
                steps_per_meeting: 2,
                motion_per_meeting: 3.0,
                max_speed: 300.0,
                rest_cm: 1e-4,
            },
            hair_hair: HairHairParams { enabled: false, ..HairHairParams::standard() },
            gap_resolution: 0.5,
            gap_period: 8,
        }
    }

    /// As [`RuntimeParams::adaptive`], hairs not pushing back on guides.
    #[must_use]
    pub fn no_two_way() -> Self {
        let mut params = Self::adaptive();
        params.two_way.enabled = false;
        params
    }

    /// Each hair's best-trained set at all times, guides in contact with solids, nothing else.
    #[must_use]
    pub fn fixed() -> Self {
        let mut params = Self::no_two_way();
        params.assign.adapt = false;
        params.residual.correction = Correction::None;
        params
    }

    /// AS16 to the letter as far as parameters reach: sets are left only when they break, rows of hairs out of contact weigh
    /// as much as any, no residual correction. The model's calibrated δ and the offsets that fade a change of set stay.
    #[must_use]
    pub fn paper() -> Self {
        let mut params = Self::adaptive();
        params.assign.cost_tolerance_cm = 0.0;
        params.assign.leave_gain_cm = -1.0;
        params.assign.growth_tolerance_cm = -1.0;
        params.two_way.solve = TwoWaySolve::LeastSquares;
        params.assign.cliques = CliqueRule::Grown;
        params.gap_period = 1;
        params.assign.steps_per_choice = 1;
        params.two_way.idle_row_weight = 1.0;
        params.two_way.memory = 0.0;
        params.residual.correction = Correction::None;
        params
    }

    /// As [`RuntimeParams::adaptive`], edges by the distance of tips alone (AS16 §7.2, after Bertails et al. 2006), sets left as soon
    /// as they break.
    #[must_use]
    pub fn tip_distance(d_max_cm: f32) -> Self {
        let mut params = Self::adaptive();
        params.assign.edge_distance = EdgeDistance::Tips { d_max_cm };
        params.assign.leave_gain_cm = -1.0;
        params.assign.avoidance = false;
        params
    }

    /// As [`RuntimeParams::adaptive`] or, where hairs are not to adapt, [`RuntimeParams::fixed`], with weights from distances
    /// (AS16 Eq. 11).
    #[must_use]
    pub fn distance_weights(adapt: bool) -> Self {
        let mut params = if adapt { Self::adaptive() } else { Self::fixed() };
        params.assign.weights = WeightRule::Distance;
        params
    }

    /// Checks every field a step divides by or loops over.
    ///
    /// # Errors
    /// [`Error::BadParameter`] names the first field out of range.
    pub fn validate(&self) -> Result<(), Error> {
        let bad = |name, value, expected| Err(Error::BadParameter { name, value, expected });
        self.hair_hair.validate()?;
        if self.residual.max_substeps == 0 {
            return bad("residual.max_substeps", 0.0, "at least one");
        }
        let steps = self.residual.steps_per_meeting;
        if !(steps.is_power_of_two() && steps <= MAX_STEPS_PER_MEETING) {
            return bad("residual.steps_per_meeting", steps as f64, "one, two or four");
        }
        if self.gap_period == 0 {
            return bad("gap_period", 0.0, "at least one");
        }
        if self.assign.steps_per_choice == 0 {
            return bad("assign.steps_per_choice", 0.0, "at least one");
        }
        if self.assign.growth_period == 0 {
            return bad("assign.growth_period", 0.0, "at least one");
        }
        if self.two_way.solve == (TwoWaySolve::ConjugateGradients { iterations: 0 }) {
            return bad("two_way.solve.iterations", 0.0, "at least one");
        }
        if let EdgeDistance::Tips { d_max_cm } = self.assign.edge_distance
            && !(d_max_cm.is_finite() && d_max_cm > 0.0)
        {
            return bad("assign.edge_distance.d_max_cm", f64::from(d_max_cm), "finite and greater than zero");
        }
        for (name, value) in [
            ("residual.motion_per_substep", self.residual.motion_per_substep),
            ("residual.motion_per_meeting", self.residual.motion_per_meeting),
            ("residual.return_rate", self.residual.return_rate),
            ("residual.max_speed", self.residual.max_speed),
            ("residual.rest_cm", self.residual.rest_cm),
            ("two_way.stiffness_over_inertia", self.two_way.stiffness_over_inertia),
            ("gap_resolution", f64::from(self.gap_resolution)),
            ("two_way.ridge", self.two_way.ridge),
        ] {
            if !(value.is_finite() && value > 0.0) {
                return bad(name, value, "finite and greater than zero");
            }
        }
        if let Some(interaction) = &self.guide_interaction {
            interaction.validate()?;
        }
        let dftl = match self.guide_integrator {
            GuideIntegrator::FollowTheLeader(dftl) => dftl,
            GuideIntegrator::Springs => DftlParams::standard(),
        };
        if !(dftl.drag_per_s.is_finite() && dftl.drag_per_s >= 0.0) {
            return bad("guide_integrator.drag_per_s", dftl.drag_per_s, "finite and not negative");
        }
        for (name, value) in [
            ("two_way.memory", self.two_way.memory),
            ("two_way.idle_row_weight", self.two_way.idle_row_weight),
            ("guide_integrator.correction", dftl.correction),
        ] {
            if !(0.0..=1.0).contains(&value) {
                return bad(name, value, "from zero to one");
            }
        }
        Ok(())
    }
}
