//! The files of `--output`: a page with all tables, the heat map twice, and the document.

use std::path::Path;

use super::document::PaperDocument;
use super::{heat_map, tables};
use crate::cli::error::CliError;

const PAGE: &str = "paper-experiments.md";
const DOCUMENT: &str = "paper-experiments.json";
const SVG: &str = "paper-heat-map.svg";
const PNG: &str = "paper-heat-map.png";

/// What is said before the tables.
const HEAD: &str = include_str!("page_head.md");

/// Writes all four files; the folder is made where it is not there.
///
/// # Errors
/// When the folder or a file cannot be written.
pub fn write(folder: &Path, document: &PaperDocument, command: &str) -> Result<(), CliError> {
    let put = |name: &str, bytes: &[u8]| {
        let path = folder.join(name);
        std::fs::write(&path, bytes).map_err(CliError::system(format!("cannot write {}", path.display())))
    };
    let failed = CliError::system(format!("cannot make the folder {}", folder.display()));
    std::fs::create_dir_all(folder).map_err(failed)?;
    let drawing = heat_map::drawing(document);
    let png = drawing.as_png().map_err(|error| CliError::Failed(format!("cannot encode {PNG}: {error}")))?;
    let json = serde_json::to_string_pretty(document).map_err(|error| CliError::Failed(error.to_string()))?;
    put(SVG, drawing.as_svg().as_bytes())?;
    put(PNG, &png)?;
    put(DOCUMENT, format!("{json}\n").as_bytes())?;
    put(PAGE, page(document, command).as_bytes())
}

fn page(document: &PaperDocument, command: &str) -> String {
    let tables: Vec<String> = tables::all(document).iter().map(tables::Table::as_markdown).collect();
    let summary = tables::summary(document).lines().collect::<Vec<_>>().join("\n- ");
    format!(
        "{HEAD}\n## Result\n\nWritten by `{command}`.\n\n- {summary}\n\n![heat map]({PNG})\n\n{}",
        tables.join("\n")
    )
}
