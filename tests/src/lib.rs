//! System tests of rugosa: what they share.

pub mod real_scan;
pub mod virtual_port;

use std::path::PathBuf;

/// The folder of real recordings and elevation models that some tests read, if there is
/// one: `$RUGOSA_DATA`, else `shared/data` beside the checkout. They are not part of
/// the project; a test that cannot find them says so loudly through [`skip`].
pub fn data_dir() -> Option<PathBuf> {
    let beside = PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("../../shared/data");
    std::env::var_os("RUGOSA_DATA")
        .map(PathBuf::from)
        .or(Some(beside))
        .filter(|folder| folder.is_dir())
}

/// One file of [`data_dir`], or `None` after a loud line.
pub fn data_file(name: &str) -> Option<PathBuf> {
    let file = data_dir().map(|folder| folder.join(name));
    let file = file.filter(|file| file.is_file());
    if file.is_none() {
        skip(&format!("real data {name} not found (set RUGOSA_DATA)"));
    }
    file
}

/// Says that a test did not run, past the capture of the test runner.
pub fn skip(why: &str) {
    use std::io::Write;
    let _ = writeln!(std::io::stderr(), "\n*** SKIPPED: {why} ***");
}
