//! The guide graph (AS16 §4.1–4.3): an edge where two guides move alike and nothing stands between them.
//!
//! Only pairs that are eligible together for some hair need an edge. Motion is compared in the head frame, so a fast turn
//! of the whole head disconnects nothing, with a second, larger threshold for letting go.

use collision::MovingSolid;
use collision::clearance::strand_ribbon_keeps_clear;
use io_formats::skinning_model::SkinningModel;
use nalgebra::Vector3;
use rayon::prelude::*;

/// Edges between guides, with the motion distance of every pair that may have one.
#[derive(Clone, Debug)]
pub struct GuideGraph {
    n_guides: usize,
    words: usize,
    /// `words` per guide: bit j of guide i's row.
    adjacency: Vec<u64>,
    /// Candidate neighbours in CSR form, ascending: (guide, index into `distance`).
    neighbour_start: Vec<u32>,
    neighbours: Vec<(u16, u32)>,
    /// AS16 Eq. (2) for each pair of the model.
    distance: Vec<f32>,
    connected: Vec<bool>,
}

/// What an edge needs.
#[derive(Clone, Copy, Debug)]
pub(crate) struct EdgeRule {
    pub similarity: bool,
    pub avoidance: bool,
    /// Resolution of the interpolation check as a multiple of a solid's least half-thickness.
    pub gap_resolution: f32,
}

/// Positions and velocities of all guides, guide-major, `n_particles` each.
pub(crate) struct GuideMotion<'a> {
    pub n_particles: usize,
    /// cm, head frame.
    pub position_in_head: &'a [[f32; 3]],
    /// cm/s, head frame.
    pub velocity_in_head: &'a [[f32; 3]],
    /// For each solid the guides' positions in its frame at the end of the step, cm.
    pub position_in_solids: &'a [Vec<Vector3<f32>>],
}

impl GuideGraph {
    pub(crate) fn new(model: &SkinningModel) -> Self {
        let n_guides = model.n_guides();
        let words = n_guides.div_ceil(64);
        let mut lists: Vec<Vec<(u16, u32)>> = vec![Vec::new(); n_guides];
        for (k, &[i, j]) in model.pairs.iter().enumerate() {
            lists[usize::from(i)].push((j, k as u32));
            lists[usize::from(j)].push((i, k as u32));
        }
        let mut neighbour_start = vec![0];
        let mut neighbours = Vec::new();
        for mut list in lists {
            list.sort_unstable();
            neighbours.extend(list);
            neighbour_start.push(neighbours.len() as u32);
        }
        Self {
            n_guides,
            words,
            adjacency: vec![0; n_guides * words],
            neighbour_start,
            neighbours,
            distance: vec![0.0; model.pairs.len()],
            connected: vec![true; model.pairs.len()],
        }
    }

    /// Guides.
    #[must_use]
    pub fn n_guides(&self) -> usize {
        self.n_guides
    }

    /// Whether the guides may be blended.
    #[must_use]
    pub fn has_edge(&self, i: usize, j: usize) -> bool {
        self.adjacency[i * self.words + j / 64] >> (j % 64) & 1 == 1
    }

    /// Share of candidate pairs that are connected.
    #[must_use]
    pub fn connectivity(&self) -> f64 {
        if self.connected.is_empty() {
            return 1.0;
        }
        self.connected.iter().filter(|&&c| c).count() as f64 / self.connected.len() as f64
    }

    /// Guides that may ever share an edge with `guide`, with the pair's index.
    pub(crate) fn candidates(&self, guide: usize) -> &[(u16, u32)] {
        &self.neighbours[self.neighbour_start[guide] as usize..self.neighbour_start[guide + 1] as usize]
    }

    pub(crate) fn pair_distance(&self, pair: u32) -> f32 {
        self.distance[pair as usize]
    }

    /// Re-decides every edge for the guides' current motion.
    pub(crate) fn update(
        &mut self,
        model: &SkinningModel,
        motion: &GuideMotion,
        solids: &[MovingSolid],
        rule: EdgeRule,
    ) {
        let n = motion.n_particles;
        let of = |values: &[[f32; 3]], g: u16| -> std::ops::Range<usize> {
            debug_assert!(usize::from(g) * n < values.len());
            usize::from(g) * n..(usize::from(g) + 1) * n
        };
        self.distance.par_iter_mut().zip(self.connected.par_iter_mut()).enumerate().for_each(
            |(k, (distance, connected))| {
                let [i, j] = model.pairs[k];
                let (ri, rj) = (of(motion.position_in_head, i), of(motion.position_in_head, j));
                *distance = motion_distance(
                    (&motion.position_in_head[ri.clone()], &motion.position_in_head[rj.clone()]),
                    (&motion.velocity_in_head[ri.clone()], &motion.velocity_in_head[rj.clone()]),
                    (model.position_scale[k], model.velocity_scale[k]),
                    model.velocity_weight,
                );
                let limit = if *connected { model.release_distance } else { model.max_distance };
                let similar = !rule.similarity || *distance < limit;
                *connected = similar
                    && (!rule.avoidance
                        || solids.iter().zip(motion.position_in_solids).all(|(solid, in_solid)| {
                            strand_ribbon_keeps_clear(
                                &solid.solid.sdf,
                                &in_solid[ri.clone()],
                                &in_solid[rj.clone()],
                                0.0,
                                rule.gap_resolution * solid.solid.half_thickness_cm,
                            )
                        }));
            },
        );
        self.adjacency.fill(0);
        for (&[i, j], &connected) in model.pairs.iter().zip(&self.connected) {
            if connected {
                let (i, j) = (usize::from(i), usize::from(j));
                self.adjacency[i * self.words + j / 64] |= 1 << (j % 64);
                self.adjacency[j * self.words + i / 64] |= 1 << (i % 64);
            }
        }
    }
}

/// How differently two guides move.
/// Implements AS16 Eq. (2), positions and velocities in the head frame.
fn motion_distance(
    position: (&[[f32; 3]], &[[f32; 3]]),
    velocity: (&[[f32; 3]], &[[f32; 3]]),
    (position_scale, velocity_scale): (f32, f32),
    velocity_weight: f32,
) -> f32 {
    squared_distance(position.0, position.1) / position_scale
        + velocity_weight * squared_distance(velocity.0, velocity.1) / velocity_scale
}

fn squared_distance(a: &[[f32; 3]], b: &[[f32; 3]]) -> f32 {
    a.iter().zip(b).map(|(p, q)| (p[0] - q[0]).powi(2) + (p[1] - q[1]).powi(2) + (p[2] - q[2]).powi(2)).sum()
}
