//! The runtime's state and what a host program sees of it.

use crate::assign::{Assignment, best_set, decode};
use crate::clusters::Clusters;
use crate::correct::{Hold, MAX_SOLIDS};
use crate::error::Error;
use crate::graph::GuideGraph;
use crate::guides::{Guides, material_of};
use crate::hair_hair::HairHair;
use crate::interpolate::{MAX_PARTICLES, Travelled, padded};
use crate::offset::N_FIXED;
use crate::params::{RuntimeParams, WeightRule};
use crate::past::{Past, Pasts};
use crate::response::{Response, return_rate};
use crate::strands::{Strands, order};
use crate::two_way::{ContactPoint, TwoWay};
use collision::Solid;
use io_formats::skinning_model::SkinningModel;
use nalgebra::{Isometry3, Point3, Vector3};
use strand_sim::Material;

/// Hair of one head: a skinning model in motion among solids.
///
/// [`Runtime::step`] moves guides and what solids touch; [`Runtime::read`] brings every hair's positions up to date. A state does not
/// depend on how often it is read. Positions are in the world frame, cm, strand-major, root first.
#[derive(Debug)]
pub struct Runtime {
    pub(crate) model: SkinningModel,
    pub(crate) params: RuntimeParams,
    pub(crate) material: Material,
    pub(crate) head: Option<Solid>,
    pub(crate) solids: Vec<Solid>,
    pub(crate) world_from_head: Isometry3<f64>,
    pub(crate) world_from_solids: Vec<Isometry3<f64>>,
    pub(crate) step_number: u64,
    /// Time since the runtime was made, s.
    pub(crate) time: f64,
    pub(crate) guides: Guides,
    /// States before the last steps.
    pub(crate) pasts: Pasts,
    pub(crate) travelled: Vec<Travelled>,
    pub(crate) graph: GuideGraph,
    pub(crate) clusters: Clusters,
    pub(crate) assignment: Assignment,
    /// Index of each strand's guide set within its kept sets.
    pub(crate) sets: Vec<u16>,
    pub(crate) strands: Strands,
    /// How offsets near solids move, for each number of steps that strands have gone unmet.
    pub(crate) responses: Vec<Responses>,
    pub(crate) spacing_cm: f64,
    /// Mass of a particle of each strand, g.
    pub(crate) particle_masses: Vec<f32>,
    pub(crate) positions: Vec<[f32; 3]>,
    pub(crate) previous: Vec<[f32; 3]>,
    pub(crate) two_way: TwoWay,
    /// Contacts of normal hairs in this step, sorted by strand.
    pub(crate) contact_points: Vec<ContactPoint>,
    /// Hair-hair correction of reads, and the head's pose at the last one.
    pub(crate) hair_hair: Option<HairHair>,
    pub(crate) world_from_head_read: Isometry3<f64>,
    pub(crate) workers: Vec<Worker>,
    pub(crate) skins: [Vec<f32>; 2],
}

/// How offsets move over a time, undivided and in each number of substeps.
#[derive(Clone, Debug)]
pub(crate) struct Responses {
    /// s.
    pub over: f64,
    pub by_substeps: Vec<Response>,
}

/// What one part of the strands met, the same whatever the number of threads.
#[derive(Clone, Debug, Default)]
pub(crate) struct Worker {
    /// Steps done when it was met last.
    pub met: u64,
    /// Deepest that any strand is left in a solid, cm.
    pub deepest: f32,
    pub holds: Vec<Hold>,
    pub near: u32,
    pub pushed: u32,
    pub lost: u32,
}

/// The same model with its strands in another order, those that follow the same guides together; and for each the strand it was.
///
/// A runtime steps and reads such a model faster than one in no order, by what its caches no longer miss. Positions then come in the order
/// of the new model.
///
/// # Errors
/// A model that breaks an invariant.
pub fn neighbours_together(model: &SkinningModel) -> Result<(SkinningModel, Vec<u32>), Error> {
    model.validate()?;
    let active: Vec<_> =
        (0..model.n_strands as usize).map(|s| decode(model, s, best_set(model, s), WeightRule::Trained)).collect();
    let order = order(model, &active);
    Ok((model.pick(&order)?, order))
}

impl Runtime {
    /// A head of hair at rest, at the given pose.
    ///
    /// `head` is the head and body as a solid in the head's frame, which guides must not enter; `solids` are what combs,
    /// parts and pushes the hair, each with its pose.
    ///
    /// # Errors
    /// A model that breaks an invariant, a guide that cannot be simulated, a parameter out of range, or a pose missing.
    pub fn new(
        model: SkinningModel,
        mut params: RuntimeParams,
        world_from_head: Isometry3<f64>,
        head: Option<Solid>,
        solids: Vec<Solid>,
        world_from_solids: &[Isometry3<f64>],
    ) -> Result<Self, Error> {
        params.validate()?;
        model.validate()?;
        if solids.len() != world_from_solids.len() {
            return Err(Error::SolidCount { given: world_from_solids.len(), expected: solids.len() });
        }
        if solids.len() > MAX_SOLIDS {
            return Err(Error::TooMany { what: "solids", given: solids.len(), most: MAX_SOLIDS });
        }
        let n = model.n_particles as usize;
        if n > MAX_PARTICLES {
            return Err(Error::TooMany { what: "particles per strand", given: n, most: MAX_PARTICLES });
        }
        let n_strands = model.n_strands as usize;
        let pad = padded(n);
        let guides = Guides::new(&model, &world_from_head, head.as_ref(), &params)?;
        let graph = GuideGraph::new(&model);
        let clusters = Clusters::new(&graph);
        let sets: Vec<u16> = (0..n_strands).map(|s| best_set(&model, s)).collect();
        let active = (0..n_strands).map(|s| decode(&model, s, sets[s], params.assign.weights)).collect();
        let strands = Strands::new(&model, pad, active);
        let positions: Vec<[f32; 3]> =
            (0..n_strands).flat_map(|s| model.rest_of(s)).map(|&p| to_world(&world_from_head, p)).collect();
        let material = material_of(&model.material);
        params.residual.return_rate = return_rate(params.residual.return_rate, &material);
        let hair_hair = if params.hair_hair.enabled {
            let rest: Vec<[f32; 3]> = (0..n_strands).flat_map(|s| model.rest_of(s).iter().copied()).collect();
            Some(HairHair::new(&rest, n, N_FIXED, head.as_ref(), params.hair_hair)?)
        } else {
            None
        };
        let state = Past {
            transforms: guides.arrays.clone(),
            world_from_head,
            world_from_solids: world_from_solids.to_vec(),
            time: 0.0,
        };
        let two_way = TwoWay::of_model(&model, strands.active.iter(), &params.two_way);
        Ok(Self {
            material,
            params,
            head,
            solids,
            world_from_head,
            world_from_solids: world_from_solids.to_vec(),
            step_number: 0,
            time: 0.0,
            pasts: Pasts::new(params.residual.steps_per_meeting, &state),
            guides,
            travelled: Vec::new(),
            assignment: Assignment::new(&model, &graph),
            graph,
            clusters,
            sets,
            strands,
            responses: Vec::new(),
            spacing_cm: mean_spacing_cm(&model),
            particle_masses: (0..n_strands).map(|s| particle_mass(&model, &material, s) as f32).collect(),
            previous: positions.clone(),
            positions,
            two_way,
            contact_points: Vec::new(),
            hair_hair,
            world_from_head_read: world_from_head,
            workers: Vec::new(),
            skins: [Vec::new(), Vec::new()],
            model,
        })
    }

    /// Strands.
    #[must_use]
    pub fn n_strands(&self) -> usize {
        self.sets.len()
    }

    /// Particles per strand.
    #[must_use]
    pub fn n_particles(&self) -> usize {
        self.model.n_particles as usize
    }

    /// Positions as of the last [`Runtime::read`]; of the hair at rest before the first.
    #[must_use]
    pub fn positions(&self) -> &[[f32; 3]] {
        &self.positions
    }

    /// Positions as of the read before it, for motion blur.
    #[must_use]
    pub fn previous_positions(&self) -> &[[f32; 3]] {
        &self.previous
    }

    /// The model in use.
    #[must_use]
    pub fn model(&self) -> &SkinningModel {
        &self.model
    }

    /// Guide positions, guide-major, head frame, cm.
    #[must_use]
    pub fn guides_in_head(&self) -> &[[f32; 3]] {
        self.guides.position_in_head()
    }

    /// The guide graph of the last step.
    #[must_use]
    pub fn graph(&self) -> &GuideGraph {
        &self.graph
    }

    /// The cliques of the last step.
    #[must_use]
    pub fn clusters(&self) -> &Clusters {
        &self.clusters
    }

    /// Guides a strand is interpolated from at present.
    #[must_use]
    pub fn guide_set(&self, strand: usize) -> &[u16] {
        let set = &self.strands.active[strand];
        &set.guides[..usize::from(set.n)]
    }

    /// 1/Σw² of a strand, averaged over its particles: how many guides it effectively follows.
    #[must_use]
    pub fn effective_guides(&self, strand: usize) -> f64 {
        let n = self.n_particles();
        let set = &self.strands.active[strand];
        let of = |i: usize| {
            let sum: f32 = set.weights_at(self.strands.u[i]).iter().map(|w| w * w).sum();
            1.0 / f64::from(sum)
        };
        (0..n).map(of).sum::<f64>() / n as f64
    }

    /// Guides a strand is interpolated from at present, each with its weight at a particle.
    pub fn weights(&self, strand: usize, particle: usize) -> impl Iterator<Item = (u16, f32)> + '_ {
        let weights = self.strands.active[strand].weights_at(self.strands.u[particle]);
        self.guide_set(strand).iter().enumerate().map(move |(k, &guide)| (guide, weights[k]))
    }

    /// A hash of guides, offsets and sets: equal states have equal hashes, however often they were read.
    #[must_use]
    pub fn state_hash(&self) -> u64 {
        // FNV-1a over the bits; no cryptography is needed to see a difference.
        let mut hash = 0xcbf2_9ce4_8422_2325_u64;
        let mut mix = |bits: u64| hash = (hash ^ bits).wrapping_mul(0x0100_0000_01b3);
        self.guides.position_in_head().iter().flatten().for_each(|x| mix(u64::from(x.to_bits())));
        self.sets.iter().for_each(|&set| mix(u64::from(set)));
        let strands = &self.strands;
        for (at, carried) in strands.carried.chunks_exact(6 * strands.pad).enumerate() {
            if strands.fades[at].carries(self.time) {
                mix(u64::from(strands.slots[at].strand));
                mix(strands.fades[at].stamp.to_bits());
                carried.iter().for_each(|x| mix(u64::from(x.to_bits())));
            }
        }
        hash
    }

    /// Puts the head elsewhere, with all its hair as it is: for a head that jumps, which a step would have tear at its hair.
    /// Solids stay where they are. Positions follow at the next read.
    pub fn put_head(&mut self, world_from_head: &Isometry3<f64>) {
        self.guides.carry_to(&self.world_from_head, world_from_head);
        self.world_from_head = *world_from_head;
        // Solids are elsewhere for the hair now.
        self.forget_touches();
    }

    /// Puts a solid elsewhere, at rest: for one that appears, leaves or jumps, which a step would sweep through all hair on its way. Hair it
    /// then stands in leaves it at no more than [`strand_sim::ContactParams::max_push_speed`].
    ///
    /// # Panics
    /// If there is no such solid; they are numbered in the order the runtime was built with.
    pub fn put_solid(&mut self, solid: usize, world_from_solid: &Isometry3<f64>) {
        self.world_from_solids[solid] = *world_from_solid;
        // Guides keep how far solids are for as long as either's motion allows.
        self.guides.carry_to(&Isometry3::identity(), &Isometry3::identity());
        self.forget_touches();
    }

    /// Forgets where solids are for the strands, and how anything has moved.
    fn forget_touches(&mut self) {
        self.strands.forget_touches();
        self.workers.iter_mut().for_each(|worker| worker.met = self.step_number);
    }

    /// Sets all guides in the head frame and reads every strand as its present set skins it, without dynamics or
    /// contact: to replay recorded guides. `guides_in_head` is ordered as [`Runtime::guides_in_head`].
    ///
    /// # Panics
    /// If the number of points is not that of the guides.
    pub fn replay(&mut self, guides_in_head: &[[f32; 3]], world_from_head: &Isometry3<f64>) {
        self.guides.place(guides_in_head);
        self.world_from_head = *world_from_head;
        self.forget_touches();
        self.strands.forget_offsets();
        self.read();
    }
}

pub(crate) fn to_world(world_from_head: &Isometry3<f64>, p: [f32; 3]) -> [f32; 3] {
    if *world_from_head == Isometry3::identity() {
        return p;
    }
    let x: Vector3<f64> = Vector3::from(p).cast();
    world_from_head.transform_point(&Point3::from(x)).coords.cast::<f32>().into()
}

/// Mean length of a segment at rest, cm.
fn mean_spacing_cm(model: &SkinningModel) -> f64 {
    let (mut sum, mut count) = (0.0, 0u64);
    for s in 0..model.n_strands as usize {
        for w in model.rest_of(s).windows(2) {
            sum += f64::from((Vector3::from(w[1]) - Vector3::from(w[0])).norm());
            count += 1;
        }
    }
    sum / count.max(1) as f64
}

/// Mass of one particle of a strand, g.
fn particle_mass(model: &SkinningModel, material: &Material, strand: usize) -> f64 {
    let rest = model.rest_of(strand);
    let length: f32 = rest.windows(2).map(|w| (Vector3::from(w[1]) - Vector3::from(w[0])).norm()).sum();
    material.linear_density_g_per_cm * f64::from(length) / (rest.len() - 1) as f64
}
