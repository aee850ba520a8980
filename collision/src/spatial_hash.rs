//! Which boxes of many small segments overlap: a hashed uniform grid, rebuilt every step.
//!
//! Hair segments are of similar length, so each box is filed once, under the cell of its lowest corner, in a grid whose
//! cells are as wide as its size class; boxes of another size (a strand stretched over a fast step) have a grid of twice the
//! cell, and so on. Cells along x share one run of buckets, so a query reads a few runs of neighbours. Invariant: the
//! pairs found are exactly the overlapping ones, each once, sorted, for any number of threads; nothing is allocated once
//! warm. MS08 §5.2 and §5.3 use a hierarchy of boxes for the same purpose.

use nalgebra::Vector3;
use rayon::prelude::*;

/// Segments handled as one piece of parallel work; fixed, so that results do not depend on the thread count.
const CHUNK: usize = 1024;

/// Candidates compared at once.
const WIDTH: usize = 8;

/// Largest box that is still of one class with the mean one, as a multiple of it: hair of one length, in any direction.
const CLASS_OF_MEAN: f64 = 1.8;

/// Cells per class size. Measured on 10 000 hanging strands of 50 particles: two and three look at fewer boxes in more
/// runs of memory, and take a fifth and three fifths longer.
const CELLS_PER_SIZE: f64 = 1.0;

/// Margin on a size: the difference of two `f32` need not be exact in `f64`.
const SIZE_ROUND_OFF: f64 = 1e-9;

/// Level of a box that takes part in nothing.
const NOWHERE: u8 = u8::MAX;

/// Levels above the lowest; the last one has room for any finite box.
const MAX_LEVEL: u8 = 200;

/// An axis-aligned box around a segment or its path, cm, rounded outward to `f32`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SegmentBox {
    min: [f32; 3],
    max: [f32; 3],
}

impl SegmentBox {
    /// The box that overlaps nothing.
    pub const EMPTY: Self = Self { min: [f32::INFINITY; 3], max: [f32::NEG_INFINITY; 3] };

    /// Box around points, `inflate` cm wider on every side; [`Self::EMPTY`] if a coordinate is not finite.
    #[inline]
    #[must_use]
    pub fn around(points: &[Vector3<f64>], inflate: f64) -> Self {
        let mut out = Self::EMPTY;
        for c in 0..3 {
            let (mut low, mut high) = (f64::INFINITY, f64::NEG_INFINITY);
            for p in points {
                if !p[c].is_finite() {
                    return Self::EMPTY;
                }
                low = low.min(p[c]);
                high = high.max(p[c]);
            }
            (out.min[c], out.max[c]) = (round_down(low - inflate), round_up(high + inflate));
        }
        if out.min.iter().chain(&out.max).all(|c| c.is_finite()) { out } else { Self::EMPTY }
    }

    /// Whether two boxes share a point.
    #[inline]
    #[must_use]
    pub fn overlaps(&self, other: &Self) -> bool {
        (0..3).all(|c| self.min[c] <= other.max[c] && other.min[c] <= self.max[c])
    }

    fn is_empty(&self) -> bool {
        !(0..3).all(|c| self.min[c] <= self.max[c])
    }

    /// Longest side, cm.
    fn size(&self) -> f64 {
        (0..3).map(|c| f64::from(self.max[c]) - f64::from(self.min[c])).fold(0.0, f64::max)
    }
}

#[inline(always)]
fn round_down(x: f64) -> f32 {
    let y = x as f32;
    if f64::from(y) > x { y.next_down() } else { y }
}

#[inline(always)]
fn round_up(x: f64) -> f32 {
    let y = x as f32;
    if f64::from(y) < x { y.next_up() } else { y }
}

/// Two segments that were kept, and what the caller found out about them.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Pair<T> {
    /// Lower segment index.
    pub i: u32,
    /// Higher segment index.
    pub j: u32,
    /// The filter's answer.
    pub data: T,
}

/// Pairs of segments in ascending order, with buffers reused from query to query.
#[derive(Clone, Debug)]
pub struct PairList<T> {
    pairs: Vec<Pair<T>>,
    /// Pairs as found, per piece of work.
    chunks: Vec<Vec<Pair<T>>>,
    /// End of the pairs of each lower segment.
    row_end: Vec<u32>,
}

impl<T> Default for PairList<T> {
    fn default() -> Self {
        Self { pairs: Vec::new(), chunks: Vec::new(), row_end: Vec::new() }
    }
}

impl<T> PairList<T> {
    /// The pairs, ascending in (i, j).
    #[must_use]
    pub fn pairs(&self) -> &[Pair<T>] {
        &self.pairs
    }
}

impl<T: Copy> PairList<T> {
    /// Puts the first chunks together in ascending order: a counting sort by the lower segment, of which each has few.
    fn put_in_order(&mut self, n_chunks: usize, n_segments: usize) {
        let Self { pairs, chunks, row_end } = self;
        pairs.clear();
        for chunk in &chunks[..n_chunks] {
            pairs.extend_from_slice(chunk);
        }
        row_end.clear();
        row_end.resize(n_segments, 0);
        for pair in pairs.iter() {
            row_end[pair.i as usize] += 1;
        }
        let mut sum = 0;
        for end in row_end.iter_mut() {
            (sum, *end) = (sum + *end, sum);
        }
        for pair in chunks[..n_chunks].iter().flatten() {
            let end = &mut row_end[pair.i as usize];
            pairs[*end as usize] = *pair;
            *end += 1;
        }
        let mut begin = 0;
        for &end in row_end.iter() {
            pairs[begin..end as usize].sort_unstable_by_key(|p| p.j);
            begin = end as usize;
        }
    }
}

/// A hashed uniform grid over the boxes of segments.
#[derive(Clone, Debug, Default)]
pub struct SegmentGrid {
    /// One per segment.
    boxes: Vec<SegmentBox>,
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
    /// Row of each entry, and its box, component by component.
    entry_row: Vec<u64>,
    entry_min: [Vec<f32>; 3],
    entry_max: [Vec<f32>; 3],
}

impl SegmentGrid {
    /// Files `n` segments under the boxes given. Segments with an empty box take part in no pair.
    pub fn rebuild(&mut self, n: usize, segment_box: impl Fn(usize) -> SegmentBox + Sync) {
        self.boxes.resize(n, SegmentBox::EMPTY);
        self.sums.resize(n.div_ceil(CHUNK), (0.0, 0, 0.0));
        self.boxes.par_chunks_mut(CHUNK).zip(&mut self.sums).enumerate().for_each(|(chunk, (boxes, sum))| {
            *sum = (0.0, 0, 0.0);
            for (k, b) in boxes.iter_mut().enumerate() {
                *b = segment_box(chunk * CHUNK + k);
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
                        let [x, y, z] = cell_of(b.min, class_size(base_size, *level));
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
                let [_, y, z] = cell_of(boxes[i as usize].min, class_size(base_size, level));
                *row = row_tag(level, y, z);
            }
        });
        for c in 0..3 {
            // Padded to the comparison's width with boxes that overlap nothing.
            let padded = entry.len() + WIDTH;
            self.entry_min[c].resize(padded, 0.0);
            self.entry_max[c].resize(padded, 0.0);
            let (mins, maxs) = (&mut self.entry_min[c], &mut self.entry_max[c]);
            mins[entry.len()..].fill(f32::INFINITY);
            maxs[entry.len()..].fill(f32::NEG_INFINITY);
            mins.par_chunks_mut(CHUNK).zip(maxs.par_chunks_mut(CHUNK)).zip(entry.par_chunks(CHUNK)).for_each(
                |((mins, maxs), entries)| {
                    for ((min, max), &i) in mins.iter_mut().zip(maxs).zip(entries) {
                        (*min, *max) = (boxes[i as usize].min[c], boxes[i as usize].max[c]);
                    }
                },
            );
        }
    }

    /// All pairs i < j of overlapping boxes for which `keep` answers, with the answer.
    pub fn collect<T: Copy + Send + Sync>(
        &self,
        list: &mut PairList<T>,
        keep: impl Fn(usize, usize) -> Option<T> + Sync,
    ) {
        self.gather(
            list,
            |i, add| {
                let own_level = self.level[i];
                let [_, own_y, own_z] = cell_of(self.boxes[i].min, class_size(self.base_size, own_level));
                for &level in self.levels.iter().filter(|&&l| l >= own_level) {
                    if level > own_level {
                        self.for_overlapping(i, level, None, add);
                    } else {
                        // Each pair of one class is found once, from the one in the earlier row.
                        self.for_overlapping(i, level, Some([own_y, own_z]), add);
                    }
                }
            },
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
            |i, add| {
                let (own_level, i_active) = (self.level[i], active(i));
                for &level in self.levels.iter().filter(|&&l| l >= own_level) {
                    if level > own_level {
                        self.for_overlapping(i, level, None, &mut |j| {
                            if i_active || active(j) {
                                add(j);
                            }
                        });
                    } else if i_active {
                        // Of two active segments the lower finds the pair; an inactive one finds none.
                        self.for_overlapping(i, level, None, &mut |j| {
                            if j > i || (j < i && !active(j)) {
                                add(j);
                            }
                        });
                    }
                }
            },
            keep,
        );
    }

    /// Runs a search from every segment and puts what it adds, and `keep` answers, in order.
    fn gather<T: Copy + Send + Sync>(
        &self,
        list: &mut PairList<T>,
        search: impl Fn(usize, &mut dyn FnMut(usize)) + Sync,
        keep: impl Fn(usize, usize) -> Option<T> + Sync,
    ) {
        let n_chunks = self.entry.len().div_ceil(CHUNK);
        if list.chunks.len() < n_chunks {
            list.chunks.resize_with(n_chunks, Vec::new);
        }
        // In the order of the grid, neighbours look at the same runs while these are in the cache.
        list.chunks[..n_chunks].par_iter_mut().zip(self.entry.par_chunks(CHUNK)).for_each(|(out, entries)| {
            out.clear();
            for i in entries.iter().map(|&i| i as usize) {
                search(i, &mut |j| {
                    let (low, high) = (i.min(j), i.max(j));
                    if let Some(data) = keep(low, high) {
                        out.push(Pair { i: low as u32, j: high as u32, data });
                    }
                });
            }
        });
        list.put_in_order(n_chunks, self.boxes.len());
    }

    /// Segments of a size class, not below the segment's own, whose boxes overlap the segment's. With a row given, only
    /// those filed in later rows, and in this row those of higher index.
    #[inline]
    fn for_overlapping(&self, i: usize, level: u8, after: Option<[i64; 2]>, found: &mut dyn FnMut(usize)) {
        let b = &self.boxes[i];
        let size = class_size(self.base_size, level);
        let n_buckets = self.bucket_start.len() - 1;
        // A box of this class that reaches up to ours starts no lower than one class size below it. Both corners are
        // rounded the way the filed corner is, so the range cannot miss its cell.
        let low = cell_of_f64(b.min.map(|c| f64::from(c) - size), size);
        let high = cell_of(b.max, size);
        let first_z = after.map_or(low[2], |[_, z]| z);
        for z in first_z..=high[2] {
            let first_y = after.map_or(low[1], |[own_y, own_z]| if z == own_z { own_y } else { low[1] });
            for y in first_y..=high[1] {
                let own_row = after == Some([y, z]);
                let mut found = |j: usize| {
                    if !own_row || j > i {
                        found(j);
                    }
                };
                let row = row_tag(level, y, z);
                let first = bucket_of(row, low[0], n_buckets) as usize;
                let last = first + (high[0] - low[0]) as usize;
                if last < n_buckets {
                    self.scan(b, row, self.bucket_start[first], self.bucket_start[last + 1], &mut found);
                } else {
                    self.scan(b, row, self.bucket_start[first], self.bucket_start[n_buckets], &mut found);
                    self.scan(b, row, 0, self.bucket_start[last - n_buckets + 1], &mut found);
                }
            }
        }
    }

    #[inline(always)]
    fn scan(&self, b: &SegmentBox, row: u64, begin: u32, end: u32, found: &mut impl FnMut(usize)) {
        let (mut k, end) = (begin as usize, end as usize);
        while k < end {
            // Whole lanes of integers, so that the comparison becomes vector instructions.
            let mut hit = [1_i32; WIDTH];
            for c in 0..3 {
                let (min, max) = (&self.entry_min[c][k..k + WIDTH], &self.entry_max[c][k..k + WIDTH]);
                for l in 0..WIDTH {
                    hit[l] &= i32::from(min[l] <= b.max[c]) & i32::from(b.min[c] <= max[l]);
                }
            }
            if hit.iter().fold(0, |any, h| any | h) != 0 {
                for l in 0..WIDTH.min(end - k) {
                    // Other rows may share the bucket; they are met again under their own name.
                    if hit[l] != 0 && self.entry_row[k + l] == row {
                        found(self.entry[k + l] as usize);
                    }
                }
            }
            k += WIDTH;
        }
    }
}

fn level_of(b: &SegmentBox, base_size: f64) -> u8 {
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

#[inline(always)]
fn cell_of(corner: [f32; 3], class_size: f64) -> [i64; 3] {
    cell_of_f64(corner.map(f64::from), class_size)
}

#[inline(always)]
fn cell_of_f64(corner: [f64; 3], class_size: f64) -> [i64; 3] {
    let per_cm = CELLS_PER_SIZE / class_size;
    // Far beyond any scene cells merge, which costs time but no pair.
    corner.map(|c| (c * per_cm).floor().clamp(-1e15, 1e15) as i64)
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
