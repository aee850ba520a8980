//! The runtime's state and what a host program sees of it.

use crate::assign::{Assignment, best_set, decode};
use crate::clusters::Clusters;
use crate::error::Error;
use crate::graph::GuideGraph;
use crate::guides::{Guides, material_of};
use crate::hair_contact::HairContact;
use crate::interpolate::{ActiveSet, padded};
use crate::params::RuntimeParams;
use crate::two_way::{ContactRow, TwoWay};
use collision::Solid;
use collision::cull::DistanceBound;
use io_formats::skinning_model::SkinningModel;
use nalgebra::{Isometry3, Point3, Vector3};
use strand_sim::Material;

/// One hair's choice and correction state.
#[derive(Clone, Debug)]
pub(crate) struct Strand {
    pub active_set: ActiveSet,
    /// Whether the strand carries an offset.
    pub has_offset: bool,
    /// Whether the strand is to be corrected in this step.
    pub listed: bool,
    /// Whether it may meet a solid in this step.
    pub near: bool,
    /// Lower bound of the distance to any solid but the head.
    pub clearance: DistanceBound,
}

/// Hair of one head: a skinning model in motion among solids.
///
/// Positions are in the world frame, cm, strand-major, root first.
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
    pub(crate) guides: Guides,
    pub(crate) graph: GuideGraph,
    pub(crate) clusters: Clusters,
    pub(crate) assignment: Assignment,
    /// Index of each strand's guide set within its kept sets.
    pub(crate) sets: Vec<u16>,
    pub(crate) strands: Vec<Strand>,
    /// Rest positions: per strand three arrays (x, y, z) of `pad` values; padding repeats the tip.
    pub(crate) rest: Vec<f32>,
    /// Position of each particle along its strand, 0 to 1, padded with one.
    pub(crate) u: Vec<f32>,
    pub(crate) pad: usize,
    pub(crate) positions: Vec<[f32; 3]>,
    pub(crate) previous: Vec<[f32; 3]>,
    /// Offset from the skinned strand and its velocity, head frame, cm and cm/s.
    pub(crate) offset: Vec<[f32; 3]>,
    pub(crate) offset_velocity: Vec<[f32; 3]>,
    pub(crate) hair_contact: HairContact,
    pub(crate) two_way: TwoWay,
    pub(crate) contact_rows: Vec<ContactRow>,
    pub(crate) spare_rows: Vec<ContactRow>,
    pub(crate) workers: Vec<Worker>,
}

/// Buffers of one worker of the strand pass.
#[derive(Clone, Debug, Default)]
pub(crate) struct Worker {
    pub skin: Vec<f32>,
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
        params: RuntimeParams,
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
        let n = model.n_particles as usize;
        let n_strands = model.n_strands as usize;
        let pad = padded(n);
        let guides = Guides::new(&model, &world_from_head, head.as_ref(), &params.guides)?;
        let graph = GuideGraph::new(&model);
        let clusters = Clusters::new(&graph);
        let assignment = Assignment::new(&model, &graph);
        let sets: Vec<u16> = (0..n_strands).map(|s| best_set(&model, s)).collect();
        let strands = (0..n_strands)
            .map(|s| {
                let active_set = decode(&model, s, sets[s], params.assign.weights);
                Strand {
                    active_set,
                    has_offset: false,
                    listed: false,
                    near: false,
                    clearance: DistanceBound::unknown(),
                }
            })
            .collect();
        let mut rest = Vec::with_capacity(n_strands * 3 * pad);
        let mut positions = Vec::with_capacity(n_strands * n);
        for s in 0..n_strands {
            let points = model.rest_of(s);
            for c in 0..3 {
                rest.extend((0..pad).map(|i| points[i.min(n - 1)][c]));
            }
            positions.extend(points.iter().map(|&p| to_world(&world_from_head, p)));
        }
        let two_way = TwoWay::new(model.n_guides(), n);
        Ok(Self {
            material: material_of(&model.material),
            params,
            head,
            solids,
            world_from_head,
            world_from_solids: world_from_solids.to_vec(),
            step_number: 0,
            guides,
            graph,
            clusters,
            assignment,
            sets,
            strands,
            rest,
            u: (0..pad).map(|i| i.min(n - 1) as f32 / (n - 1) as f32).collect(),
            pad,
            previous: positions.clone(),
            offset: vec![[0.0; 3]; positions.len()],
            offset_velocity: vec![[0.0; 3]; positions.len()],
            positions,
            hair_contact: HairContact::default(),
            two_way,
            contact_rows: Vec::new(),
            spare_rows: Vec::new(),
            workers: Vec::new(),
            model,
        })
    }

    /// Strands.
    #[must_use]
    pub fn n_strands(&self) -> usize {
        self.strands.len()
    }

    /// Particles per strand.
    #[must_use]
    pub fn n_particles(&self) -> usize {
        self.model.n_particles as usize
    }

    /// Positions after the last step.
    #[must_use]
    pub fn positions(&self) -> &[[f32; 3]] {
        &self.positions
    }

    /// Positions after the step before it, for motion blur.
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
        let set = &self.strands[strand].active_set;
        &set.guides[..usize::from(set.n)]
    }

    /// 1/Σw² of a strand, averaged over its particles: how many guides it effectively follows.
    #[must_use]
    pub fn effective_guides(&self, strand: usize) -> f64 {
        let n = self.n_particles();
        let set = &self.strands[strand].active_set;
        let of = |i: usize| {
            let sum: f32 = set.weights_at(self.u[i]).iter().map(|w| w * w).sum();
            1.0 / f64::from(sum)
        };
        (0..n).map(of).sum::<f64>() / n as f64
    }

    /// A hash of positions, offsets and sets: equal states have equal hashes.
    #[must_use]
    pub fn state_hash(&self) -> u64 {
        // FNV-1a over the bits; no cryptography is needed to see a difference.
        let mut hash = 0xcbf2_9ce4_8422_2325_u64;
        let mut mix = |bits: u64| hash = (hash ^ bits).wrapping_mul(0x0100_0000_01b3);
        for p in self.positions.iter().chain(&self.offset).chain(self.guides.position_in_head()) {
            p.iter().for_each(|x| mix(u64::from(x.to_bits())));
        }
        for &set in &self.sets {
            mix(u64::from(set));
        }
        hash
    }

    /// Sets all guides in the head frame and interpolates every strand from its best-trained set, without dynamics or
    /// contact: to replay recorded guides. `guides_in_head` is ordered as [`Runtime::guides_in_head`].
    ///
    /// # Panics
    /// If the number of points is not that of the guides.
    pub fn replay(&mut self, guides_in_head: &[[f32; 3]], world_from_head: &Isometry3<f64>) {
        self.guides.place(guides_in_head);
        self.world_from_head = *world_from_head;
        self.interpolate_all();
    }
}

pub(crate) fn to_world(world_from_head: &Isometry3<f64>, p: [f32; 3]) -> [f32; 3] {
    if *world_from_head == Isometry3::identity() {
        return p;
    }
    let x: Vector3<f64> = Vector3::from(p).cast();
    world_from_head.transform_point(&Point3::from(x)).coords.cast::<f32>().into()
}
