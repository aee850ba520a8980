//! Which of many small segments may come within reach of each other over a step: a hashed uniform grid, rebuilt every
//! step.
//!
//! Hair segments are of similar length, so the box around each one's way is filed once, under the cell of its lowest corner, in a grid whose
//! cells are as wide as its size class; boxes of another size (a strand stretched over a fast step) have a grid of twice the
//! cell, and so on. Cells along x share one run of buckets, so a query reads a few runs of neighbours. What
//! overlaps is compared along two axes more (`sweep`) before the caller sees it. Invariant: no pair that comes within reach
//! is missed, each comes once, sorted, the same for any number of threads; nothing is allocated once warm. MS08 §5.2 and §5.3 use a hierarchy of boxes for the same purpose.

mod pair_list;
mod sweep;

use crate::segment_pair::Sweep;
use multiversion::multiversion;
use rayon::prelude::*;
use sweep::{CellBlock, EntryBlock, Motion, Query, SweepBox, WIDTH, any};

pub use pair_list::{Pair, PairList};

/// Segments handled as one piece of parallel work; fixed, so that results do not depend on the thread count.
const CHUNK: usize = 1024;

/// Largest box that is still of one class with the mean one, as a multiple of it: hair of one length, in any direction.
const CLASS_OF_MEAN: f64 = 1.8;

/// Cells per class size. Cells are narrower than boxes so that what is filed in one moves much alike, and whole cells can
/// be passed over. Measured on 10 000 settled strands of 50 particles: with three, two fifths slower.
const CELLS_PER_SIZE: f64 = 2.0;

/// Margin on a size: the difference of two `f32` need not be exact in `f64`.
const SIZE_ROUND_OFF: f64 = 1e-9;

/// Level of a box that takes part in nothing.
const NOWHERE: u8 = u8::MAX;

/// Levels above the lowest; the last one has room for any finite box.
const MAX_LEVEL: u8 = 200;

/// A hashed uniform grid over the boxes of segments.
#[derive(Clone, Debug, Default)]
pub struct SegmentGrid {
    /// One per segment.
    boxes: Vec<SweepBox>,
    motions: Vec<Motion>,
    /// Distance within which segments are asked for, cm, rounded up.
    reach: f32,
    /// Size class and bucket of each segment.
    level: Vec<u8>,
    bucket: Vec<u32>,
    /// First entry of each bucket; one more than there are buckets.
    bucket_start: Vec<u32>,
    /// Longest side allowed at level 0, cm; doubled from level to level.
    base_size: f64,
    /// Levels in use, ascending.
    levels: Vec<u8>,
    /// Sum, number and maximum of the box sizes, per chunk.
    sums: Vec<(f64, u32, f64)>,
    /// Segments in bucket order.
    entry: Vec<u32>,
    /// Row of each entry.
    entry_row: Vec<u64>,
    /// What entries, and buckets of them, are compared by.
    entry_blocks: Vec<EntryBlock>,
    cell_blocks: Vec<CellBlock>,
}

impl SegmentGrid {
    /// Files `n` segments, to be asked which come within `reach` cm of each other. One with an end that is not finite
    /// takes part in no pair.
    pub fn rebuild(&mut self, n: usize, reach: f64, sweep: impl Fn(usize) -> Sweep + Sync) {
        self.reach = (reach as f32).next_up();
        self.boxes.resize(n, SweepBox::EMPTY);
        self.motions.resize(n, Motion::default());
        self.sums.resize(n.div_ceil(CHUNK), (0.0, 0, 0.0));
        let filed = self.boxes.par_chunks_mut(CHUNK).zip(self.motions.par_chunks_mut(CHUNK));
        filed.zip(&mut self.sums).enumerate().for_each(|(chunk, ((boxes, motions), sum))| {
            *sum = (0.0, 0, 0.0);
            for (k, (b, motion)) in boxes.iter_mut().zip(motions).enumerate() {
                let sweep = sweep(chunk * CHUNK + k);
                (*b, *motion) = (SweepBox::around(&sweep, 0.5 * reach), Motion::of(&sweep));
                if !b.is_empty() {
                    *sum = (sum.0 + b.size(), sum.1 + 1, sum.2.max(b.size()));
                }
            }
        });
        let all = self.sums.iter().fold((0.0, 0u32, 0.0f64), |s, c| (s.0 + c.0, s.1 + c.1, s.2.max(c.2)));
        let mean = all.0 / f64::from(all.1.max(1));
        let one_class = all.2 * (1.0 + SIZE_ROUND_OFF);
        self.base_size = if one_class <= CLASS_OF_MEAN * mean { one_class } else { mean };
        // Boxes of no size, or none at all.
        if self.base_size <= f64::MIN_POSITIVE {
            self.base_size = 1.0;
        }
        self.assign_buckets();
        self.sort_into_buckets();
        self.copy_entries();
    }

    fn assign_buckets(&mut self) {
        let n = self.boxes.len();
        let n_buckets = n.next_power_of_two().max(WIDTH);
        self.bucket_start.clear();
        self.bucket_start.resize(n_buckets + 1, 0);
        self.level.resize(n, NOWHERE);
        self.bucket.resize(n, 0);
        let base_size = self.base_size;
        let boxes = &self.boxes;
        self.level.par_chunks_mut(CHUNK).zip(self.bucket.par_chunks_mut(CHUNK)).zip(boxes.par_chunks(CHUNK)).for_each(
            |((levels, buckets), boxes)| {
                for ((level, bucket), b) in levels.iter_mut().zip(buckets).zip(boxes) {
                    *level = level_of(b, base_size);
                    if *level != NOWHERE {
                        let [x, y, z] = cell_of(b, class_size(base_size, *level));
                        *bucket = bucket_of(row_tag(*level, y, z), x, n_buckets);
                    }
                }
            },
        );
        let mut seen = [false; MAX_LEVEL as usize + 1];
        for &level in &self.level {
            if level != NOWHERE {
                seen[level as usize] = true;
            }
        }
        self.levels.clear();
        self.levels.extend((0..=MAX_LEVEL).filter(|&l| seen[l as usize]));
    }

    /// A counting sort: linear, stable, and without a temporary buffer.
    fn sort_into_buckets(&mut self) {
        let mut n_filed = 0;
        for (&bucket, &level) in self.bucket.iter().zip(&self.level) {
            if level != NOWHERE {
                self.bucket_start[bucket as usize] += 1;
                n_filed += 1;
            }
        }
        let mut sum = 0;
        for start in &mut self.bucket_start {
            sum += *start;
            *start = sum;
        }
        self.entry.resize(n_filed, 0);
        // Backwards from each bucket's end: afterwards every count is the bucket's start, and its entries ascend.
        for i in (0..self.bucket.len()).rev() {
            if self.level[i] != NOWHERE {
                let place = &mut self.bucket_start[self.bucket[i] as usize];
                *place -= 1;
                self.entry[*place as usize] = i as u32;
            }
        }
    }

    fn copy_entries(&mut self) {
        let (base_size, boxes, level, entry) = (self.base_size, &self.boxes, &self.level, &self.entry);
        self.entry_row.resize(entry.len(), 0);
        self.entry_row.par_chunks_mut(CHUNK).zip(entry.par_chunks(CHUNK)).for_each(|(rows, entries)| {
            for (row, &i) in rows.iter_mut().zip(entries) {
                let level = level[i as usize];
                let [_, y, z] = cell_of(&boxes[i as usize], class_size(base_size, level));
                *row = row_tag(level, y, z);
            }
        });
        let motions = &self.motions;
        self.entry_blocks.resize(entry.len().div_ceil(WIDTH), EntryBlock::EMPTY);
        self.entry_blocks.par_iter_mut().zip(entry.par_chunks(WIDTH)).with_min_len(CHUNK).for_each(
            |(block, entries)| {
                *block = EntryBlock::EMPTY;
                for (lane, &i) in entries.iter().enumerate() {
                    block.set(lane, &boxes[i as usize], &motions[i as usize]);
                }
            },
        );
        let start = &self.bucket_start;
        self.cell_blocks.resize((start.len() - 1).div_ceil(WIDTH), CellBlock::EMPTY);
        self.cell_blocks.par_iter_mut().enumerate().with_min_len(CHUNK).for_each(|(k, block)| {
            *block = CellBlock::EMPTY;
            for lane in 0..WIDTH {
                let [begin, end] = [start[WIDTH * k + lane] as usize, start[WIDTH * k + lane + 1] as usize];
                if begin < end {
                    block.set(lane, entry[begin..end].iter().map(|&i| &motions[i as usize]));
                }
            }
        });
    }

    /// All pairs i < j that may come within reach and for which `keep` answers, with the answer.
    pub fn collect<T: Copy + Send + Sync>(
        &self,
        list: &mut PairList<T>,
        keep: impl Fn(usize, usize) -> Option<T> + Sync,
    ) {
        self.collect_within(list, |_| f64::INFINITY, keep);
    }

    /// As [`Self::collect`], of pairs that may come within the reach (cm) of both segments; one beyond the reach the grid
    /// was built for counts as that.
    pub fn collect_within<T: Copy + Send + Sync>(
        &self,
        list: &mut PairList<T>,
        reach: impl Fn(usize) -> f64 + Sync,
        keep: impl Fn(usize, usize) -> Option<T> + Sync,
    ) {
        self.gather(
            list,
            |i, found| {
                let reach = (reach(i) as f32).next_up().min(self.reach);
                let own_level = self.level[i];
                let [_, own_y, own_z] = cell_of(&self.boxes[i], class_size(self.base_size, own_level));
                for &level in self.levels.iter().filter(|&&l| l >= own_level) {
                    // Each pair of one class is found once, from the one in the earlier row.
                    search(self, i, level, (level == own_level).then_some([own_y, own_z]), reach, found);
                }
            },
            |_, _| true,
            keep,
        );
    }

    /// As [`Self::collect`], of pairs with at least one active segment only; where few are, this is much cheaper.
    pub fn collect_active<T: Copy + Send + Sync>(
        &self,
        list: &mut PairList<T>,
        active: impl Fn(usize) -> bool + Sync,
        keep: impl Fn(usize, usize) -> Option<T> + Sync,
    ) {
        self.gather(
            list,
            |i, found| {
                let own_level = self.level[i];
                for &level in self.levels.iter().filter(|&&l| l > own_level || (l == own_level && active(i))) {
                    search(self, i, level, None, self.reach, found);
                }
            },
            |i, j| {
                if self.level[i] < self.level[j] {
                    active(i) || active(j)
                } else {
                    // Of two active segments the lower finds the pair; an inactive one finds none.
                    j > i || (j < i && !active(j))
                }
            },
            keep,
        );
    }

    /// Runs a search from every segment and puts in order what of its findings is `wanted`, and `keep` answers.
    fn gather<T: Copy + Send + Sync>(
        &self,
        list: &mut PairList<T>,
        search: impl Fn(usize, &mut Vec<u32>) + Sync,
        wanted: impl Fn(usize, usize) -> bool + Sync,
        keep: impl Fn(usize, usize) -> Option<T> + Sync,
    ) {
        let n_chunks = self.entry.len().div_ceil(CHUNK);
        if list.chunks.len() < n_chunks {
            list.chunks.resize_with(n_chunks, Default::default);
        }
        // In the order of the grid, neighbours look at the same runs while these are in the cache.
        list.chunks[..n_chunks].par_iter_mut().zip(self.entry.par_chunks(CHUNK)).for_each(|((out, found), entries)| {
            out.clear();
            for i in entries.iter().map(|&i| i as usize) {
                found.clear();
                search(i, found);
                for j in found.iter().map(|&j| j as usize).filter(|&j| wanted(i, j)) {
                    let (low, high) = (i.min(j), i.max(j));
                    if let Some(data) = keep(low, high) {
                        out.push(Pair { i: low as u32, j: high as u32, data });
                    }
                }
            }
        });
        list.put_in_order(n_chunks, self.boxes.len());
    }
}

/// Adds the segments of a size class, not below the segment's own, that may come within its reach. With a row given, only
/// those filed in later rows, and in this row those of higher index.
#[multiversion(targets("x86_64+avx512f+avx512vl+avx512dq+fma", "x86_64+avx2+fma", "aarch64+neon"))]
fn search(grid: &SegmentGrid, i: usize, level: u8, after: Option<[i64; 2]>, reach: f32, found: &mut Vec<u32>) {
    let size = class_size(grid.base_size, level);
    let query = Query::new(grid.boxes[i], grid.motions[i], reach, size as f32);
    let b = &query.bounds;
    let n_buckets = grid.bucket_start.len() - 1;
    // A box of this class that overlaps ours has its centre within half a class size of it.
    let margin = |x: f32| 0.5 * size * (1.0 + SIZE_ROUND_OFF) + SIZE_ROUND_OFF * f64::from(x).abs();
    let low = cell_at(b.min.map(|x| f64::from(x) - margin(x)), size);
    let high = cell_at(b.max.map(|x| f64::from(x) + margin(x)), size);
    let first_z = after.map_or(low[2], |[_, z]| z);
    for z in first_z..=high[2] {
        let first_y = after.map_or(low[1], |[own_y, own_z]| if z == own_z { own_y } else { low[1] });
        for y in first_y..=high[1] {
            let first_segment = if after == Some([y, z]) { i + 1 } else { 0 };
            let row = row_tag(level, y, z);
            let first = bucket_of(row, low[0], n_buckets) as usize;
            let last = first + (high[0] - low[0]) as usize;
            if last < n_buckets {
                grid.scan(&query, row, [first, last + 1], first_segment, found);
            } else {
                grid.scan(&query, row, [first, n_buckets], first_segment, found);
                grid.scan(&query, row, [0, last - n_buckets + 1], first_segment, found);
            }
        }
    }
}

impl SegmentGrid {
    /// Looks through a range of buckets: at the cells first, then at the entries of those that may hold something.
    #[inline(always)]
    fn scan(&self, query: &Query, row: u64, buckets: [usize; 2], first_segment: usize, found: &mut Vec<u32>) {
        let [first, end] = buckets;
        let mut entries = [0, 0];
        for block in first / WIDTH..end.div_ceil(WIDTH) {
            let hit = self.cell_blocks[block].may_hold(query);
            for l in 0..WIDTH {
                let bucket = WIDTH * block + l;
                if hit[l] != 0 && bucket >= first && bucket < end {
                    let [from, to] = [bucket, bucket + 1].map(|b| self.bucket_start[b] as usize);
                    if from != entries[1] {
                        self.scan_entries(query, row, entries, first_segment, found);
                        entries[0] = from;
                    }
                    entries[1] = to;
                }
            }
        }
        self.scan_entries(query, row, entries, first_segment, found);
    }

    #[inline(always)]
    fn scan_entries(&self, query: &Query, row: u64, entries: [usize; 2], first_segment: usize, found: &mut Vec<u32>) {
        let [first, end] = entries;
        for block in first / WIDTH..end.div_ceil(WIDTH) {
            let hit = self.entry_blocks[block].may_meet(query);
            if any(&hit) {
                for k in first.max(WIDTH * block)..end.min(WIDTH * (block + 1)) {
                    // Other rows may share the bucket; they are met again under their own name.
                    if hit[k % WIDTH] != 0 && self.entry_row[k] == row && self.entry[k] as usize >= first_segment {
                        found.push(self.entry[k]);
                    }
                }
            }
        }
    }
}

fn level_of(b: &SweepBox, base_size: f64) -> u8 {
    if b.is_empty() {
        return NOWHERE;
    }
    let size = b.size() * (1.0 + 0.5 * SIZE_ROUND_OFF);
    let mut level = 0;
    while level < MAX_LEVEL && size > class_size(base_size, level) {
        level += 1;
    }
    level
}

/// Longest side at a level, cm.
#[inline(always)]
fn class_size(base_size: f64, level: u8) -> f64 {
    // Exact: a power of two, put together from its exponent.
    base_size * f64::from_bits((1023 + u64::from(level)) << 52)
}

/// Cell of a box's centre.
#[inline(always)]
fn cell_of(b: &SweepBox, class_size: f64) -> [i64; 3] {
    cell_at([0, 1, 2].map(|c| 0.5 * (f64::from(b.min[c]) + f64::from(b.max[c]))), class_size)
}

#[inline(always)]
fn cell_at(place: [f64; 3], class_size: f64) -> [i64; 3] {
    let per_cm = CELLS_PER_SIZE / class_size;
    // Far beyond any scene cells merge, which costs time but no pair.
    place.map(|c| (c * per_cm).floor().clamp(-1e15, 1e15) as i64)
}

/// Names a row of cells along x. Rows named alike are 2²⁸ cells apart and never in one query.
#[inline(always)]
fn row_tag(level: u8, y: i64, z: i64) -> u64 {
    const MASK: u64 = (1 << 28) - 1;
    (u64::from(level) << 56) | ((y as u64 & MASK) << 28) | (z as u64 & MASK)
}

/// Cells of a row follow each other, from a place scattered by the row.
#[inline(always)]
fn bucket_of(row: u64, x: i64, n_buckets: usize) -> u32 {
    let mut hash = row.wrapping_mul(0x9e37_79b9_7f4a_7c15);
    hash = (hash ^ (hash >> 32)).wrapping_mul(0xd6e8_feb8_6659_fd93);
    ((hash >> 20).wrapping_add(x as u64) & (n_buckets as u64 - 1)) as u32
}
