//! A comb drawn at random, at one to five metres a second and turning, through strands (DESIGN §4: true continuous
//! detection). `cargo xtask bench collision` does the same ten thousand times.

use hair_bench::comb_sweeps::{Comb, detection, response};

#[test]
fn no_segment_at_rest_is_gone_through_unseen() {
    let comb = Comb::dressing().expect("a comb");
    let [followed, at_end] = detection(&comb, 300, 1);
    assert!(followed.met > 300, "{followed:?}: the law was hardly tried");
    assert_eq!(followed.tunnelled, 0, "{followed:?}");
    // What the field at the end of the step alone would have let through: most.
    assert!(2 * at_end.tunnelled > at_end.met, "{at_end:?}");
}

#[test]
fn no_segment_of_a_simulated_strand_is_gone_through() {
    let comb = Comb::dressing().expect("a comb");
    let by_field = response(&comb, 100, 1, false).expect("strands");
    let followed = response(&comb, 100, 1, true).expect("strands");
    assert!(by_field.tunnelled > 500, "{by_field:?}: the law was hardly tried");
    assert_eq!((followed.tunnelled, followed.given_up), (0, 0), "{followed:?}");
    // Strands that the comb winds around their held ends until they are twelve times their length.
    let wound = response(&comb, 1, 3_816, true).expect("strands");
    assert_eq!((wound.tunnelled, wound.given_up), (0, 0), "{wound:?}");
}
