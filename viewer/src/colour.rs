//! What hair is coloured by: its own colour, or what is known of it.
//!
//! Every map from a number to a colour is a plain function here, tested against the numbers; the driver only interpolates
//! between particles. Colours are linear, 0..1; a picture's bytes are sRGB ([`to_srgb`]).

use crate::error::Error;

/// What decides the colour of hair.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum ColourBy<'a> {
    /// Hair of this colour, as light comes off it: linear red, green, blue.
    Hair([f32; 3]),
    /// Hair of several colours, one per strand.
    Strand(&'a [[f32; 3]]),
    /// The guide that counts most, one number per strand: strands of one guide share a colour ([`guide_colour`]).
    Guide(&'a [u32]),
    /// A share 0..1, one number per strand, e.g. the largest weight of its guides ([`heat_colour`]).
    Weight(&'a [f32]),
    /// Depth within a solid (cm), one number per particle: pale outside (zero or less), red from `worst_cm` on.
    Penetration {
        /// `n_strands * n_particles` depths, strand-major, root first.
        depths: &'a [f32],
        /// Depth shown in full red.
        worst_cm: f32,
    },
    /// Speed (cm/s), one number per particle ([`heat_colour`] of its share of `fastest`).
    Velocity {
        /// `n_strands * n_particles` speeds, strand-major, root first.
        speeds: &'a [f32],
        /// Speed shown in the last colour.
        fastest: f32,
    },
}

impl ColourBy<'_> {
    /// One colour per particle; one alone where all share it.
    ///
    /// # Errors
    /// An array of the wrong length, or a scale that is not positive.
    pub fn colours(&self, n_strands: usize, n_particles: usize) -> Result<Vec<[f32; 3]>, Error> {
        let check = |what, found, expected| {
            if found == expected { Ok(()) } else { Err(Error::Length { what, found, expected }) }
        };
        let positive = |what, value: f32| {
            let good = value.is_finite() && value > 0.0;
            if good { Ok(()) } else { Err(Error::BadValue { what, value: value.into(), must: "positive" }) }
        };
        let all = n_strands * n_particles;
        let each = |of: &dyn Fn(usize) -> [f32; 3]| -> Vec<[f32; 3]> {
            (0..n_strands).flat_map(|s| std::iter::repeat_n(of(s), n_particles)).collect()
        };
        match *self {
            Self::Hair(colour) => Ok(vec![colour]),
            Self::Strand(colours) => {
                check("the list of colours", colours.len(), n_strands)?;
                Ok(each(&|s| colours[s]))
            }
            Self::Guide(guides) => {
                check("the list of guides", guides.len(), n_strands)?;
                Ok(each(&|s| guide_colour(guides[s])))
            }
            Self::Weight(weights) => {
                check("the list of weights", weights.len(), n_strands)?;
                Ok(each(&|s| heat_colour(weights[s])))
            }
            Self::Penetration { depths, worst_cm } => {
                check("the list of depths", depths.len(), all)?;
                positive("the worst depth", worst_cm)?;
                Ok(depths.iter().map(|d| depth_colour(d / worst_cm)).collect())
            }
            Self::Velocity { speeds, fastest } => {
                check("the list of speeds", speeds.len(), all)?;
                positive("the fastest speed", fastest)?;
                Ok(speeds.iter().map(|v| heat_colour(v / fastest)).collect())
            }
        }
    }

    /// Whether colours stand for numbers, so that light must not bend them.
    pub fn is_measure(&self) -> bool {
        !matches!(self, Self::Hair(_) | Self::Strand(_))
    }
}

/// A colour for a guide: hues a golden angle apart, so that neighbours in number differ, in three strengths.
pub fn guide_colour(guide: u32) -> [f32; 3] {
    let hue = (f64::from(guide) * 0.618_033_988_749_895).fract() as f32;
    let value = [0.85, 0.55, 0.7][guide as usize % 3];
    // Red, green and blue a third of a turn apart on the wheel of hues.
    [0.0, 2.0 / 3.0, 1.0 / 3.0].map(|phase| {
        let x = ((hue + phase).fract() * 6.0 - 3.0).abs() - 1.0;
        value * (0.12 + 0.88 * x.clamp(0.0, 1.0))
    })
}

/// Stops of [`heat_colour`], at equal distances.
const HEAT: [[f32; 3]; 5] =
    [[0.02, 0.03, 0.25], [0.02, 0.30, 0.60], [0.05, 0.55, 0.15], [0.80, 0.60, 0.03], [0.75, 0.05, 0.02]];

/// A colour for a share: dark blue at 0, blue, green, yellow, red at 1; what is outside or no number takes the nearer end.
pub fn heat_colour(share: f32) -> [f32; 3] {
    let x = if share.is_nan() { 0.0 } else { share.clamp(0.0, 1.0) } * (HEAT.len() - 1) as f32;
    let k = (x as usize).min(HEAT.len() - 2);
    let t = x - k as f32;
    [0, 1, 2].map(|c| HEAT[k][c] + t * (HEAT[k + 1][c] - HEAT[k][c]))
}

/// Pale grey outside; yellow just within, red at the worst depth and beyond.
fn depth_colour(share: f32) -> [f32; 3] {
    if share > 0.0 { [0.8, 0.5 * (1.0 - share.min(1.0)), 0.02] } else { [0.42, 0.44, 0.46] }
}

/// The byte of a picture that shows a linear value: sRGB, rounded; below 0 and above 1 as the ends.
pub fn to_srgb(linear: f32) -> u8 {
    let x = linear.clamp(0.0, 1.0);
    let encoded = if x <= 0.003_130_8 { 12.92 * x } else { 1.055 * x.powf(1.0 / 2.4) - 0.055 };
    (255.0 * encoded + 0.5) as u8
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene::BLONDE;

    /// Products of f32 in 0..1.
    const ROUND_OFF: f32 = 1e-6;

    fn near(a: [f32; 3], b: [f32; 3]) -> bool {
        a.iter().zip(&b).all(|(x, y)| (x - y).abs() < ROUND_OFF)
    }

    #[test]
    fn known_speeds_have_known_colours() {
        let speeds = [0.0, 25.0, 50.0, 75.0, 100.0, 400.0];
        let colours = ColourBy::Velocity { speeds: &speeds, fastest: 100.0 }.colours(2, 3).unwrap();
        for (k, colour) in colours.iter().enumerate() {
            assert!(near(*colour, HEAT[k.min(4)]), "speed {}: {colour:?}", speeds[k]);
        }
    }

    #[test]
    fn only_what_is_inside_a_solid_turns_red() {
        let by = ColourBy::Penetration { depths: &[-1.0, 0.0, 0.05, 0.1, 3.0], worst_cm: 0.1 };
        let colours = by.colours(1, 5).unwrap();
        assert_eq!(colours[0], colours[1]);
        assert!(colours[0][0] < 0.5 && colours[2][0] > 0.7 && colours[2][1] > colours[3][1]);
        assert_eq!(colours[3], colours[4]);
    }

    #[test]
    fn guides_near_in_number_are_far_in_colour() {
        for guide in 0..400 {
            let (a, b) = (guide_colour(guide), guide_colour(guide + 1));
            let distance: f32 = a.iter().zip(&b).map(|(x, y)| (x - y).abs()).sum();
            assert!(distance > 0.3, "guides {guide} and the next: {a:?} {b:?}");
            assert!(a.iter().all(|c| (0.0..=1.0).contains(c)));
        }
    }

    #[test]
    fn an_array_of_the_wrong_length_is_refused_and_so_is_a_scale_of_zero() {
        assert!(matches!(ColourBy::Weight(&[0.5]).colours(2, 5), Err(Error::Length { found: 1, expected: 2, .. })));
        assert!(ColourBy::Guide(&[0; 10]).colours(2, 5).is_err());
        assert!(ColourBy::Strand(&[BLONDE; 10]).colours(2, 5).is_err());
        assert_eq!(ColourBy::Strand(&[BLONDE, [0.5; 3]]).colours(2, 5).unwrap()[4..6], [BLONDE, [0.5; 3]]);
        let still = ColourBy::Velocity { speeds: &[0.0; 10], fastest: 0.0 };
        assert!(matches!(still.colours(2, 5), Err(Error::BadValue { .. })));
        assert_eq!(ColourBy::Weight(&[0.0, 1.0]).colours(2, 5).unwrap().len(), 10);
    }

    #[test]
    fn the_ends_of_a_picture_are_black_and_white_and_the_middle_is_brighter_than_half() {
        assert_eq!([to_srgb(-1.0), to_srgb(0.0), to_srgb(1.0), to_srgb(7.0), to_srgb(0.5)], [0, 0, 255, 255, 188]);
    }
}
