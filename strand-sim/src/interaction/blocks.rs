//! Pairs by blocks of strands, so that impulses are given in parallel and yet one after the other wherever they meet.
//!
//! Strands are cut into a fixed number of blocks. A round takes blocks two by two, as in a tournament: what it works on at
//! the same time shares no particle, so the result is that of one pair after the other in the order of [`Blocks::pairs`],
//! whatever the thread count. A block of particles is small enough to stay in cache. Invariant: impulses come in opposite
//! pairs, hence momentum is kept to round-off.

use super::repulsion::{Field, RepulsionParams, RepulsionReport, repel_pair};
use super::{FourPoints, Near, Strands};
use collision::segment_pair::closest_points;
use collision::spatial_hash::Pair;
use nalgebra::Vector3;
use rayon::prelude::*;

/// Blocks the strands are cut into; even.
pub(crate) const BLOCKS: usize = 32;

/// Rounds in which each block meets each other one once; before them, one in which it meets itself.
const ROUNDS: usize = BLOCKS - 1;

/// Pairs of segments, the lower first, by the blocks that they are in.
#[derive(Clone, Debug, Default)]
pub struct Blocks {
    /// By search group, then `BLOCKS` times the lower block plus the higher.
    pub(super) lists: Vec<Vec<Vec<[u32; 2]>>>,
    packed: Vec<Packed>,
}

/// Pairs whose particles are asked for before the first of them is worked on.
const AHEAD: usize = 16;

/// Particles copied as one piece of parallel work.
const PACK: usize = 4096;

/// The two blocks of a meeting in a round, the lower first: all stand in a ring but the last, and the ring turns.
fn meeting(round: usize, table: usize) -> (usize, usize) {
    let (a, b) =
        if table == 0 { (round, BLOCKS - 1) } else { ((round + table) % ROUNDS, (round + ROUNDS - table) % ROUNDS) };
    (a.min(b), a.max(b))
}

impl Blocks {
    pub(super) fn prepare(&mut self, n_groups: usize) {
        self.lists.resize_with(n_groups, || vec![Vec::new(); BLOCKS * BLOCKS]);
        self.lists.par_iter_mut().for_each(|lists| lists.iter_mut().for_each(Vec::clear));
    }

    fn strands_per_block(strands: &Strands) -> usize {
        (strands.n_points() / strands.n_particles()).div_ceil(BLOCKS).max(1)
    }

    pub(super) fn segments_per_block(strands: &Strands) -> usize {
        Self::strands_per_block(strands) * (strands.n_particles() - 1)
    }

    /// The pairs in the order in which [`Self::repel`] takes them, or one with the same result.
    pub fn pairs(&self) -> impl Iterator<Item = [u32; 2]> + '_ {
        let alone = (0..BLOCKS).map(|a| (a, a));
        let met = (0..ROUNDS).flat_map(|round| (0..BLOCKS / 2).map(move |table| meeting(round, table)));
        alone.chain(met).flat_map(|(a, b)| self.of(a, b))
    }

    fn of(&self, a: usize, b: usize) -> impl Iterator<Item = [u32; 2]> + '_ {
        self.lists.iter().flat_map(move |lists| lists[a * BLOCKS + b].iter().copied())
    }

    /// As [`super::repel`], of the pairs held here that are near now, none of which is linked.
    pub fn repel(
        &mut self,
        strands: &Strands,
        params: &RepulsionParams,
        dt: f64,
        velocity: &mut [Vector3<f64>],
    ) -> RepulsionReport {
        let mut packed = std::mem::take(&mut self.packed);
        packed.resize(velocity.len(), Packed::default());
        let all = packed.par_iter_mut().zip(strands.position).zip(strands.inv_mass).zip(&*velocity);
        all.with_min_len(PACK).for_each(|(((packed, position), inv_mass), velocity)| {
            *packed = Packed { position: *position, velocity: *velocity, inv_mass: *inv_mass };
        });
        let report = self.repel_packed(strands, &mut packed, params, dt);
        let back = velocity.par_iter_mut().zip(&packed).with_min_len(PACK);
        back.for_each(|(velocity, packed)| *velocity = packed.velocity);
        self.packed = packed;
        report
    }

    fn repel_packed(
        &self,
        strands: &Strands,
        packed: &mut [Packed],
        params: &RepulsionParams,
        dt: f64,
    ) -> RepulsionReport {
        let per_block = Self::strands_per_block(strands) * strands.n_particles();
        let mut rest = packed.chunks_mut(per_block);
        let mut blocks: [&mut [Packed]; BLOCKS] = std::array::from_fn(|_| rest.next().unwrap_or_default());
        let mut report = RepulsionReport::default();
        let mut alone = [RepulsionReport::default(); BLOCKS];
        blocks.par_iter_mut().zip(&mut alone).enumerate().with_max_len(1).for_each(|(a, (block, report))| {
            let mut field = TwoBlocks { low: block, from: a * per_block, high: &mut [], high_from: usize::MAX };
            *report = self.repel_met(a, a, strands, params, dt, &mut field);
        });
        alone.into_iter().for_each(|part| report += part);
        for round in 0..ROUNDS {
            let mut tables: [Table; BLOCKS / 2] = std::array::from_fn(|table| {
                let (a, b) = meeting(round, table);
                let (low, high) = (std::mem::take(&mut blocks[a]), std::mem::take(&mut blocks[b]));
                let field = TwoBlocks { low, from: a * per_block, high, high_from: b * per_block };
                Table { a, b, field, report: RepulsionReport::default() }
            });
            tables.par_iter_mut().with_max_len(1).for_each(|Table { a, b, field, report }| {
                *report = self.repel_met(*a, *b, strands, params, dt, field);
            });
            for table in tables {
                (blocks[table.a], blocks[table.b]) = (table.field.low, table.field.high);
                report += table.report;
            }
        }
        report
    }

    /// Two blocks' pairs, some at a time: what is read first for all of them arrives while the others are waited for.
    fn repel_met(
        &self,
        a: usize,
        b: usize,
        strands: &Strands,
        params: &RepulsionParams,
        dt: f64,
        field: &mut TwoBlocks,
    ) -> RepulsionReport {
        let mut report = RepulsionReport::default();
        for lists in &self.lists {
            for pairs in lists[a * BLOCKS + b].chunks(AHEAD) {
                let mut ends = [[Vector3::zeros(); 4]; AHEAD];
                for (ends, &[i, j]) in ends.iter_mut().zip(pairs) {
                    let (i, j) = (strands.first_particle(i as usize), strands.first_particle(j as usize));
                    let on_a = field.pair_at(i).each_ref().map(|end| end.position);
                    let on_b = field.pair_at(j).each_ref().map(|end| end.position);
                    *ends = [on_a[0], on_a[1], on_b[0], on_b[1]];
                }
                for (&[i, j], ends) in pairs.iter().zip(&ends) {
                    let near = closest_points(&[ends[0], ends[1]], &[ends[2], ends[3]]);
                    let data = Near { s: near.s, t: near.t, offset: near.offset };
                    report += repel_pair(strands, &Pair { i, j, data }, params, dt, field);
                }
            }
        }
        report
    }
}

/// Two blocks that meet.
struct Table<'a> {
    a: usize,
    b: usize,
    field: TwoBlocks<'a>,
    report: RepulsionReport,
}

/// Everything about a particle that repulsion asks for, in one line of the cache.
#[derive(Clone, Copy, Debug, Default)]
#[repr(align(64))]
struct Packed {
    position: Vector3<f64>,
    velocity: Vector3<f64>,
    inv_mass: f64,
}

/// The particles of one block or two.
struct TwoBlocks<'a> {
    low: &'a mut [Packed],
    /// First particle of the lower block.
    from: usize,
    high: &'a mut [Packed],
    /// First particle of the higher one; beyond all particles where there is none.
    high_from: usize,
}

impl TwoBlocks<'_> {
    #[inline(always)]
    fn pair_at(&mut self, particle: usize) -> &mut [Packed; 2] {
        let (block, at) = if particle < self.high_from {
            (&mut *self.low, particle - self.from)
        } else {
            (&mut *self.high, particle - self.high_from)
        };
        block[at..].first_chunk_mut().expect("a segment lies within its strand, and that within its block")
    }
}

impl Field for TwoBlocks<'_> {
    #[inline(always)]
    fn difference(&mut self, points: &FourPoints) -> Vector3<f64> {
        let (p, w) = (&points.particles, &points.weights);
        let [a, b] = *self.pair_at(p[0]);
        let [c, d] = *self.pair_at(p[2]);
        a.velocity * w[0] + b.velocity * w[1] + c.velocity * w[2] + d.velocity * w[3]
    }

    #[inline(always)]
    fn inv_mass(&mut self, points: &FourPoints) -> f64 {
        let (p, w) = (&points.particles, &points.weights);
        let [a, b] = *self.pair_at(p[0]);
        let [c, d] = *self.pair_at(p[2]);
        let masses = [a.inv_mass, b.inv_mass, c.inv_mass, d.inv_mass];
        (0..4).map(|k| w[k] * w[k] * masses[k]).sum()
    }

    #[inline(always)]
    fn push(&mut self, points: &FourPoints, impulse: &Vector3<f64>) {
        for k in [0, 2] {
            for (n, end) in self.pair_at(points.particles[k]).iter_mut().enumerate() {
                end.velocity += impulse * (points.weights[k + n] * end.inv_mass);
            }
        }
    }
}
