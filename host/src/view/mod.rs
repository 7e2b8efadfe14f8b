//! What is looked at in a browser: one page for the report of a finished map and for the
//! live view of one that grows.
//!
//! | file | what |
//! |---|---|
//! | `data` | the map as the page wants it |
//! | `page.html`, `page.js`, `page.css` | the page; drawn by Plotly, whose script is inside |
//! | `live` | the server of the live view |
//!
//! A report is one file of about 5 MB that needs no network.

mod data;
pub mod live;

pub use data::{Data, Timings};

use crate::error::{Failure, Result};
use crate::io::atomic;
use plotly::Plot;
use std::path::Path;

const PAGE: &str = include_str!("page.html");
const STYLE: &str = include_str!("page.css");
const SCRIPT: &str = include_str!("page.js");

/// Writes the report: one HTML file with everything in it.
pub fn report(path: &Path, data: &Data) -> Result<()> {
    let json = data.json()?;
    atomic::write(path, |writer| writer.write_all(page(&json).as_bytes()))
}

/// The page that shows `data` (JSON, or `null`: what a live server sends).
fn page(data: &str) -> String {
    let scripts = Plot::offline_js_sources();
    // the first is Plotly; the second sets formulas, of which there are none
    let plotly = scripts
        .split_once("</script>")
        .map_or(scripts.as_str(), |(first, _)| first);
    let plotly = plotly.split_once('>').map_or(plotly, |(_, script)| script);
    PAGE.replace("/*style*/", STYLE)
        .replace("/*script*/", SCRIPT)
        .replace("/*data*/null", &data.replace("</", "<\\/"))
        .replace("/*plotly*/", plotly)
}

impl Data {
    /// As the page reads it.
    pub fn json(&self) -> Result<String> {
        serde_json::to_string(self).map_err(Failure::runtime)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_page_is_self_contained_and_data_cannot_leave_its_place() {
        let html = page("{\"title\":\"</script><b>\"}");
        assert!(html.len() > 4_000_000);
        assert!(html.contains("plotly.js v") && html.contains("{\"title\":\"<\\/script><b>\"}"));
        for hole in ["/*data*/", "/*style*/", "/*script*/", "/*plotly*/"] {
            assert!(!html.contains(hole), "{hole}");
        }
        for needle in ["src=", "href=", "@import", "url(", "fetch("] {
            assert!(![PAGE, STYLE, SCRIPT].concat().contains(needle), "{needle}");
        }
    }
}
