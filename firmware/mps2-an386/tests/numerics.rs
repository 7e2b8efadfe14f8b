//! On-target tests: the numerics have the fingerprints that they have on the host.
//! Ends with exit code 0, or 101 at the first difference.
#![no_std]
#![no_main]

use board as _; // log output
use core::panic::PanicInfo;
use semihosting::process;

#[panic_handler]
fn panic(_: &PanicInfo) -> ! {
    process::exit(101)
}

#[defmt_test::tests]
mod tests {
    use rugosa_numerics::CHECKS;

    #[test]
    fn every_fingerprint_is_that_of_the_host() {
        for check in CHECKS {
            let (got, expected) = ((check.run)(), check.expected);
            defmt::info!("{=str}: {=u32:08x}", check.name, got);
            defmt::assert_eq!(got, expected, "{=str}", check.name);
        }
    }
}
