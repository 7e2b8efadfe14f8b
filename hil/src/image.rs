//! Where the firmware's images are.

use anyhow::{Result, bail};
use std::path::{Path, PathBuf};

/// The image of this name: in `$RUGOSA_IMAGES`, or where `cargo xtask firmware` puts it
/// in a checkout.
pub fn image(name: &str) -> Result<PathBuf> {
    let built = Path::new(env!("CARGO_MANIFEST_DIR"))
        .join("../target/bare-metal/thumbv7em-none-eabihf/release");
    let folder = std::env::var_os("RUGOSA_IMAGES").map_or(built, PathBuf::from);
    let image = folder.join(name);
    if !image.is_file() {
        bail!(
            "no image {}: cargo xtask firmware builds it",
            image.display()
        );
    }
    Ok(image)
}
