//! What a study leaves: tables as CSV and text, figures as SVG, and one page that shows all of them.

use std::fmt::Write as _;
use std::path::{Path, PathBuf};

use lanecraft_drive::config::ConfigError;
use lanecraft_drive::scenario::ScenarioError;

use crate::report::html::escape;

/// Why a study failed.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum StudyError {
    /// A number of the study is out of range.
    #[error(transparent)]
    Config(#[from] ConfigError),
    /// A scene could not be built.
    #[error(transparent)]
    Scenario(#[from] ScenarioError),
    /// A file could not be written.
    #[error("cannot write {}: {source}", path.display())]
    Write {
        /// Which.
        path: PathBuf,
        /// Why.
        source: std::io::Error,
    },
    /// A table could not be written as CSV.
    #[error("cannot write {}: {source}", path.display())]
    Csv {
        /// Which.
        path: PathBuf,
        /// Why.
        source: csv::Error,
    },
}

/// A table.
#[derive(Clone, Debug, PartialEq)]
pub struct Table {
    /// Part of its file's name.
    pub name: String,
    /// What it holds.
    pub caption: String,
    /// Heads of the columns, with units.
    pub head: Vec<String>,
    /// Rows of as many cells.
    pub rows: Vec<Vec<String>>,
}

impl Table {
    /// An empty table.
    pub(crate) fn new(name: &str, caption: &str, head: &[&str]) -> Self {
        let head = head.iter().map(|&cell| cell.to_owned()).collect();
        Self { name: name.into(), caption: caption.into(), head, rows: Vec::new() }
    }

    /// For a terminal: the first column to the left, all others to the right.
    pub fn text(&self) -> String {
        let lines: Vec<&Vec<String>> = std::iter::once(&self.head).chain(&self.rows).collect();
        let width = |column: usize| lines.iter().map(|row| row[column].chars().count()).max().unwrap_or(0);
        let widths: Vec<usize> = (0..self.head.len()).map(width).collect();
        let mut text = format!("{}\n", self.caption);
        for row in lines {
            let mut line = String::new();
            for (column, (cell, &width)) in row.iter().zip(&widths).enumerate() {
                let _ = if column == 0 { write!(line, "{cell:<width$}") } else { write!(line, "  {cell:>width$}") };
            }
            text += line.trim_end();
            text.push('\n');
        }
        text
    }

    /// For a document in Markdown.
    pub fn markdown(&self) -> String {
        let row = |cells: &[String]| format!("| {} |\n", cells.join(" | "));
        let rule = row(&vec!["---".to_owned(); self.head.len()]);
        let rows: String = self.rows.iter().map(|cells| row(cells)).collect();
        format!("{}\n\n{}{rule}{rows}", self.caption, row(&self.head))
    }

    fn html(&self) -> String {
        let row = |cells: &[String], tag: &str| {
            let mut html = "<tr>".to_owned();
            for cell in cells {
                let _ = write!(html, "<{tag}>{}</{tag}>", escape(cell));
            }
            html + "</tr>\n"
        };
        let body: String = self.rows.iter().map(|cells| row(cells, "td")).collect();
        format!(
            "<div class=\"card\"><h3>{}</h3><div class=\"scroll\"><table><thead>{}</thead><tbody>{body}</tbody></table></div></div>\n",
            escape(&self.caption),
            row(&self.head, "th")
        )
    }
}

/// A figure.
#[derive(Clone, Debug, PartialEq)]
pub struct Figure {
    /// Part of its file's name.
    pub name: String,
    /// What it shows.
    pub title: String,
    /// The `svg` element, with classes of the page's style.
    pub svg: String,
    /// Names of its series with their classes' numbers; may be empty.
    pub legend: Vec<(String, usize)>,
}

impl Figure {
    /// Self-contained, with the style inside.
    fn file(&self) -> String {
        let opened = "<svg xmlns=\"http://www.w3.org/2000/svg\" ";
        let style = format!("<style>{}{}</style>", include_str!("figure.css"), SERIES);
        let inside = self.svg.replacen("<svg ", opened, 1);
        inside.replacen(">\n", &format!(">\n{style}\n"), 1)
    }

    pub(crate) fn html(&self) -> String {
        let mut legend = String::new();
        for (name, series) in &self.legend {
            let _ = write!(legend, "<li><i class=\"key k{series}\"></i>{}</li>", escape(name));
        }
        let legend = if legend.is_empty() { legend } else { format!("<ul class=\"keys\">{legend}</ul>") };
        format!("<div class=\"card\"><h3>{}</h3>{legend}{}</div>\n", escape(&self.title), self.svg)
    }
}

/// Colors of the series outside of a page, as in its light scheme.
const SERIES: &str = ":root{--surface:#fff;--ink:#1d2126;--muted:#5f6670;--line:#e3e5e8;--accent:#0b63b5;--c0:#0072b2;--c1:#d55e00;--c2:#00855f;--c3:#b0588a;--c4:#b97f00;--c5:#2f8fca;--c6:#6b7280;--c7:#7a4fb5}";

/// A finished study.
#[derive(Clone, Debug, PartialEq)]
pub struct StudyReport {
    /// Its name, which begins all its files' names.
    pub name: &'static str,
    /// Headline.
    pub title: String,
    /// What it says, a few sentences.
    pub summary: String,
    /// Tables.
    pub tables: Vec<Table>,
    /// Figures.
    pub figures: Vec<Figure>,
}

impl StudyReport {
    /// Tables and summary for a terminal.
    pub fn text(&self) -> String {
        let tables: Vec<String> = self.tables.iter().map(Table::text).collect();
        format!("{}\n{}\n", tables.join("\n"), self.summary)
    }

    /// Writes all files into `folder`, which is made if need be, and gives their paths.
    pub fn write(&self, folder: &Path) -> Result<Vec<PathBuf>, StudyError> {
        let failed = |path: &Path| {
            let path = path.to_owned();
            move |source| StudyError::Write { path, source }
        };
        std::fs::create_dir_all(folder).map_err(failed(folder))?;
        let mut written = Vec::new();
        for table in &self.tables {
            let path = folder.join(format!("{}-{}.csv", self.name, table.name));
            let csv_failed = |source| StudyError::Csv { path: path.clone(), source };
            let mut writer = csv::Writer::from_path(&path).map_err(csv_failed)?;
            for row in std::iter::once(&table.head).chain(&table.rows) {
                writer.write_record(row).map_err(csv_failed)?;
            }
            writer.flush().map_err(failed(&path))?;
            written.push(path);
        }
        let figures = self.figures.iter().map(|figure| (format!("{}-{}.svg", self.name, figure.name), figure.file()));
        for (name, text) in figures.chain([(format!("{}.html", self.name), self.page())]) {
            let path = folder.join(name);
            std::fs::write(&path, text).map_err(failed(&path))?;
            written.push(path);
        }
        Ok(written)
    }

    /// One page with all of it.
    pub(crate) fn page(&self) -> String {
        let figures: String = self.figures.iter().map(Figure::html).collect();
        let tables: String = self.tables.iter().map(Table::html).collect();
        let (title, summary) = (escape(&self.title), escape(&self.summary));
        let style = [include_str!("../report/page.css"), include_str!("figure.css")].concat();
        format!(
            "<!doctype html>\n<html lang=\"en\"><head><meta charset=\"utf-8\">\
             <meta name=\"viewport\" content=\"width=device-width, initial-scale=1\">\
             <meta http-equiv=\"Content-Security-Policy\" content=\"default-src 'none'; style-src 'unsafe-inline'\">\
             <title>{title}</title><style>{style}</style></head>\n<body><main><header><h1>{title}</h1>\
             <p class=\"lead\">{summary}</p></header>\n<section><div class=\"grid\">{figures}</div></section>\n\
             <section>{tables}</section></main></body></html>\n"
        )
    }
}
