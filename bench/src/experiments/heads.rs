//! How much hair each size of a report has, and the heads its experiments share.
//!
//! Most experiments stage their solids on one head, the salon's: 5,000 hairs where every change is checked, 150,000 with 400
//! guides (AS16 Table 2) at full size. Full space is run on the first hairs alone, since a prefix of a generated groom is an even,
//! sparser groom.

use crate::error::Error;
use crate::evidence::{Place, Size, Trained};
use crate::runtime_bench::{Subject, resized};
use crate::training_motions::train_little;
use adaptive_runtime::RuntimeParams;
use io_formats::scene::{GroomSource, HairStyle, Scene};

/// How many hairs do what.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Amount {
    /// Hairs of the head.
    pub hairs: usize,
    /// Guides among them.
    pub guides: usize,
    /// Hairs whose share inside solids is counted.
    pub measured: usize,
    /// Hairs simulated one by one beside them.
    pub reference: usize,
}

/// Amounts for a head of which AS16 has `hairs` with `guides`.
#[must_use]
pub fn amount(size: Size, hairs: usize, guides: usize) -> Amount {
    match size {
        Size::Smoke => Amount { hairs: hairs / 30, guides: guides / 4, measured: 500, reference: 200 },
        Size::Quick => Amount { hairs: hairs / 28, guides: guides / 3, measured: 550, reference: 220 },
        Size::Full => Amount { hairs, guides, measured: 10_000, reference: 2_000 },
    }
}

/// Hairs and guides of AS16's salon.
pub const SALON: (usize, usize) = (150_000, 400);

/// Gives a scene with a generated groom so many hairs and guides.
pub fn resize(scene: &mut Scene, amount: Amount) {
    if let GroomSource::Generated(groom) = &mut scene.groom.source {
        groom.strands = amount.hairs;
    }
    scene.groom.guides = amount.guides;
}

/// The salon's scene at the place's size. At full size it is trained as little as benchmarks need, or training would take most
/// of the report's time.
///
/// # Errors
/// As [`Place::scene`].
pub fn salon_scene(place: &dyn Place, style: HairStyle) -> Result<Scene, Error> {
    let size = place.size();
    let mut scene = place.scene(if size == Size::Full { "salon-full" } else { "salon" })?;
    if size == Size::Full {
        train_little(&mut scene);
    }
    resize(&mut scene, amount(size, SALON.0, SALON.1));
    dress(&mut scene, style);
    Ok(scene)
}

/// Gives a scene hair of another style, with what it is made of.
pub fn dress(scene: &mut Scene, style: HairStyle) {
    if let GroomSource::Generated(groom) = &mut scene.groom.source {
        groom.style = style;
    }
    scene.material.preset = style;
}

/// A scene of its own hair at the place's size, trained as little as benchmarks need.
///
/// # Errors
/// As [`Place::scene`].
pub fn own_scene(place: &dyn Place, name: &str, hairs: usize, guides: usize) -> Result<Scene, Error> {
    let mut scene = place.scene(name)?;
    train_little(&mut scene);
    resize(&mut scene, amount(place.size(), hairs, guides));
    Ok(scene)
}

/// The salon's head with straight hair, trained.
///
/// # Errors
/// Whatever making it meets.
pub fn salon(place: &dyn Place) -> Result<Trained, Error> {
    place.trained(salon_scene(place, HairStyle::Straight)?)
}

/// Hairs at most where many ways to skin are compared.
const COMPARED: usize = 20_000;

/// The salon's head where many ways are compared: no more hairs than that takes, since a prefix of a head is a sparser head.
///
/// # Errors
/// As [`salon`].
pub fn few(place: &dyn Place) -> Result<(Trained, Amount), Error> {
    let mut head = salon(place)?;
    let mut size = amount(place.size(), SALON.0, SALON.1);
    if size.hairs > COMPARED {
        head.model = resized(&head.model, COMPARED, 1)?;
        size = Amount { hairs: COMPARED, measured: 4_000, ..size };
    }
    Ok((head, size))
}

/// The head as the whole method skins it.
#[must_use]
pub fn adaptive(head: &Trained) -> Subject<'_> {
    Subject { world: &head.world, model: &head.model, params: RuntimeParams::adaptive() }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn larger_reports_have_more_of_everything_and_full_ones_what_the_paper_has() {
        let [smoke, quick, full] = [Size::Smoke, Size::Quick, Size::Full].map(|size| amount(size, SALON.0, SALON.1));
        for (less, more) in [(smoke, quick), (quick, full)] {
            assert!(less.hairs < more.hairs && less.guides < more.guides);
            assert!(less.measured < more.measured && less.reference < more.reference);
        }
        for a in [smoke, quick, full] {
            assert!(a.reference <= a.measured && a.measured <= a.hairs && a.guides < a.hairs, "{a:?}");
        }
        assert_eq!((full.hairs, full.guides), SALON);
    }
}
