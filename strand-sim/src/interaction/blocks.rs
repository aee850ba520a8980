//! Pairs by blocks of strands, so that impulses are given in parallel and yet one after the other wherever they meet.
//!
//! Strands are cut into a fixed number of blocks. A round takes blocks two by two, as in a tournament: what it works on at
//! the same time shares no particle, so the result is that of one pair after the other in the order of [`Blocks::pairs`],
//! whatever the thread count. A block of particles is small enough to stay in cache. Invariant: impulses come in opposite
//! pairs, hence momentum is kept to round-off.

use super::repulsion::{RepulsionParams, RepulsionReport, repel_pair};
use super::{Near, Strands, TwoFields};
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
}

/// The two blocks of a meeting in a round, the lower first: all stand in a ring but the last, and the ring turns.
fn meeting(round: usize, table: usize) -> (usize, usize) {
    let (a, b) = if table == 0 {
        (round, BLOCKS - 1)
    } else {
        ((round + table) % ROUNDS, (round + ROUNDS - table) % ROUNDS)
    };
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
        &self,
        strands: &Strands,
        params: &RepulsionParams,
        dt: f64,
        velocity: &mut [Vector3<f64>],
    ) -> RepulsionReport {
        let per_block = Self::strands_per_block(strands) * strands.n_particles();
        let mut rest = velocity.chunks_mut(per_block);
        let mut blocks: [&mut [Vector3<f64>]; BLOCKS] = std::array::from_fn(|_| rest.next().unwrap_or_default());
        let mut report = RepulsionReport::default();
        let mut alone = [RepulsionReport::default(); BLOCKS];
        blocks.par_iter_mut().zip(&mut alone).enumerate().with_max_len(1).for_each(|(a, (block, report))| {
            let mut field = TwoFields { low: block, from: a * per_block, high: &mut [], high_from: usize::MAX };
            self.of(a, a).for_each(|pair| *report += repel_one(strands, pair, params, dt, &mut field));
        });
        alone.into_iter().for_each(|part| report += part);
        for round in 0..ROUNDS {
            let mut tables: [Table; BLOCKS / 2] = std::array::from_fn(|table| {
                let (a, b) = meeting(round, table);
                let (low, high) = (std::mem::take(&mut blocks[a]), std::mem::take(&mut blocks[b]));
                let field = TwoFields { low, from: a * per_block, high, high_from: b * per_block };
                Table { a, b, field, report: RepulsionReport::default() }
            });
            tables.par_iter_mut().with_max_len(1).for_each(|Table { a, b, field, report }| {
                self.of(*a, *b).for_each(|pair| *report += repel_one(strands, pair, params, dt, field));
            });
            for table in tables {
                (blocks[table.a], blocks[table.b]) = (table.field.low, table.field.high);
                report += table.report;
            }
        }
        report
    }
}

/// Two blocks that meet.
struct Table<'a> {
    a: usize,
    b: usize,
    field: TwoFields<'a>,
    report: RepulsionReport,
}

#[inline(always)]
fn repel_one(
    strands: &Strands,
    [i, j]: [u32; 2],
    params: &RepulsionParams,
    dt: f64,
    velocity: &mut TwoFields,
) -> RepulsionReport {
    let near = closest_points(&strands.segment(i as usize), &strands.segment(j as usize));
    repel_pair(strands, &Pair { i, j, data: Near { s: near.s, t: near.t, offset: near.offset } }, params, dt, velocity)
}
