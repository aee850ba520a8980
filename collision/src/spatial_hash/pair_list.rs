//! Pairs of segments as a search found them, put in ascending order: what makes results independent of how the search was
//! divided among threads. Buffers are kept from query to query.

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
    /// Pairs as found, per piece of work, and the names of those a search has yet to look at.
    pub(super) chunks: Vec<(Vec<Pair<T>>, Vec<u32>)>,
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
    pub(super) fn put_in_order(&mut self, n_chunks: usize, n_segments: usize) {
        let Self { pairs, chunks, row_end } = self;
        pairs.clear();
        for (chunk, _) in &chunks[..n_chunks] {
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
        for pair in chunks[..n_chunks].iter().flat_map(|(chunk, _)| chunk) {
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
