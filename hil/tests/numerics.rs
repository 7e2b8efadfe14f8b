//! The numerics on this machine have the fingerprints that they have on a Cortex-M.

use rugosa_numerics::CHECKS;

#[test]
fn every_fingerprint_is_the_committed_one() {
    for check in CHECKS {
        assert_eq!((check.run)(), check.expected, "{}", check.name);
    }
}
