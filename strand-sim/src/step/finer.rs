//! Substeps taken again in smaller pieces, for strands that no straight way takes past a surface.
//!
//! A fast tooth may ask a strand for a way that no straight move of its particles gives: around its held end, say. Such a
//! strand, and no other of its batch, goes the same substep in pieces, each free of the surface on its own straight way. Hairs
//! that meet do not act on it meanwhile. Invariant: what comes out is what that many plain substeps give.

use super::{Span, StepInput, StepParams, Work};
use crate::surface_contact::SurfaceReport;
use crate::system::{Batch, BatchState, StrandSystem, get, set};

/// Pieces tried, one number after the other.
const PIECES: [usize; 4] = [4, 16, 64, 256];

/// State and buffers of strands that are on a way of their own.
#[derive(Debug)]
pub(crate) struct Finer {
    state: BatchState,
    work: Work,
}

impl BatchState {
    fn copy_from(&mut self, other: &Self) {
        self.position.clone_from(&other.position);
        self.velocity.clone_from(&other.velocity);
        self.sights.clone_from(&other.sights);
        self.clearance.clone_from(&other.clearance);
        self.bearings.copy_from(&other.bearings);
    }
}

impl StrandSystem {
    /// Leads strands (a bit each) to where pieces of the substep lead, and counts what still goes through a surface
    /// however fine they are.
    pub(super) fn go_finer(
        &self,
        batch: &Batch,
        state: &BatchState,
        input: &StepInput,
        params: &StepParams,
        span: Span,
        mut lanes: u8,
        work: &mut Work,
    ) {
        let new = || Box::new(Finer { state: state.clone(), work: Work::new(self) });
        let mut finer = work.finer.take().unwrap_or_else(new);
        work.report.refined += lanes.count_ones();
        for pieces in PIECES {
            let found = self.take_pieces(batch, state, input, params, span, pieces, lanes, &mut finer);
            let is_last = pieces == PIECES[PIECES.len() - 1];
            let settled = if is_last { lanes } else { lanes & !found.passing };
            for lane in (0..batch.strands.len()).filter(|lane| settled >> lane & 1 != 0) {
                for p in 0..self.topologies[batch.topology].n_rig {
                    set(&mut work.next[p], lane, get(&finer.state.position[p], lane));
                    set(&mut work.next_velocity[p], lane, get(&finer.state.velocity[p], lane));
                }
            }
            work.report.touches += found.answered;
            lanes &= !settled;
            if lanes == 0 {
                work.report.passing += found.unresolved;
                break;
            }
        }
        work.finer = Some(finer);
    }

    fn take_pieces(
        &self,
        batch: &Batch,
        state: &BatchState,
        input: &StepInput,
        params: &StepParams,
        span: Span,
        pieces: usize,
        lanes: u8,
        finer: &mut Finer,
    ) -> SurfaceReport {
        let Finer { state: on_the_way, work } = finer;
        on_the_way.copy_from(state);
        self.sample_air(batch, state, input, work);
        let part = |k: usize| span.begin + (span.end - span.begin) * k as f64 / pieces as f64;
        let mut sum = SurfaceReport::default();
        for k in 0..pieces {
            let piece = Span { begin: part(k), end: part(k + 1), h: span.h / pieces as f64 };
            self.set_out(batch, on_the_way, input, params, piece, work);
            sum = sum.and(self.stop_at_surfaces(batch, on_the_way, input, piece, lanes, work));
            self.arrive(batch, on_the_way, input, params, piece, work);
        }
        sum
    }
}
