//! What strands remember of where they bore on solids: which contacts pulled, which were torn from where they stuck.
//!
//! Which contacts bear and which stick is known only once a solve has said what they exert (MS08 §5.1 leaves it open). Another
//! solve to correct a wrong guess costs as much as the first, so the guess of the next substep is what this one has found.
//! Only what is torn anew is solved for again, and only in lanes where that is so: no strand feels its batch.

use crate::body_contact::{Contact, Reaction};
use crate::lanes::LANES;

/// One place where strands may bear: a particle, or a segment between its ends.
#[derive(Clone, Copy, Debug, Default)]
struct Place {
    /// Lanes in which the contact pulled when last solved for.
    left: u8,
    /// What Coulomb allowed the torn contact of each lane, dyn; zero where it was not torn.
    torn: [f32; LANES],
}

/// Memory of one batch.
#[derive(Clone, Debug, Default)]
pub(crate) struct Bearings {
    /// By rig particle: that particle, and the segment that it begins.
    places: Vec<[Place; 2]>,
}

/// A torn contact sticks again once it slides at no more than this share of the speed that was expected.
const RESTICK: f64 = 0.5;

impl Bearings {
    /// Nothing remembered.
    pub fn new(n_rig: usize) -> Self {
        Self { places: vec![[Place::default(); 2]; n_rig] }
    }

    /// Remembers what another batch of the same topology does.
    pub fn copy_from(&mut self, other: &Self) {
        self.places.clone_from(&other.places);
    }

    /// Forgets one lane.
    pub fn forget(&mut self, lane: usize) {
        for place in self.places.iter_mut().flatten() {
            place.left &= !(1 << lane);
            place.torn[lane] = 0.0;
        }
    }

    fn place(&mut self, contact: &Contact) -> &mut Place {
        let [near, far] = contact.weight;
        let particle = if near == 0.0 { contact.ends[1] } else { contact.ends[0] };
        &mut self.places[particle][usize::from(near > 0.0 && far > 0.0)]
    }

    /// Whether a contact pulled when last solved for, and what Coulomb allowed it if it was torn (dyn).
    pub fn of(&mut self, contact: &Contact) -> (bool, f64) {
        let place = self.place(contact);
        (place.left >> contact.lane & 1 != 0, f64::from(place.torn[contact.lane]))
    }

    /// Remembers what a solve has found of a contact; a contact that is torn anew gets the grip that it slides with.
    /// Returns whether it is.
    pub fn learn(&mut self, contact: &mut Contact, reaction: &Reaction) -> bool {
        let place = self.place(contact);
        let (lane, bit) = (contact.lane, 1 << contact.lane);
        let (was_torn, pulls) = (place.torn[lane] > 0.0, contact.is_pulled(reaction));
        place.left = if pulls { place.left | bit } else { place.left & !bit };
        if pulls {
            return false;
        }
        let allowed = contact.friction * reaction.pressing.max(0.0);
        // What slides fast enough to be slowed after the solve is torn when it comes to be held in it.
        let is_torn = contact.grip == 0.0
            || reaction.gripping > if was_torn { RESTICK * contact.grip * contact.slip } else { allowed };
        // Neighbours take the load from each other from one substep to the next: half of the last is kept.
        let kept = if was_torn { 0.5 * (f64::from(place.torn[lane]) + allowed) } else { allowed };
        place.torn[lane] = if is_torn { (kept as f32).max(f32::MIN_POSITIVE) } else { 0.0 };
        if contact.grip == 0.0 {
            return false;
        }
        if is_torn && !was_torn {
            contact.grip = allowed / contact.slip;
        }
        is_torn && !was_torn
    }
}
