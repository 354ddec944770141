//! The page that shows all scenarios.

use std::fmt::Write as _;
use std::path::Path;

use lanecraft_drive::scenario::{ScenarioError, ScenarioFile};

const HEAD: &str = "\
# Gallery

Every scenario in `scenarios/`, driven by `rule:best-lane` with seed 1. Each picture shows the road around the ego at the start, the
distance of everybody to the ego over time (a line that falls through 0 is a vehicle overtaken), the ego's lane and its speed.
[scenarios.md](scenarios.md) says how to write your own.

```sh
lanecraft scenario list                                        # names and descriptions
lanecraft scenario draw scenarios/*.toml --out docs/gallery    # draws these pictures
```
";

/// The gallery of these files, each with its text, as Markdown beside a folder `gallery` with the pictures.
pub fn gallery_page(files: &[(&Path, String)]) -> Result<String, ScenarioError> {
    let mut page = HEAD.to_owned();
    for (path, text) in files {
        let (stem, file) = (name_of(path), ScenarioFile::from_toml(text)?);
        let _ = write!(
            page,
            "\n## {}\n\n{} [`{stem}.toml`](../scenarios/{stem}.toml)\n\n![{}](gallery/{stem}.svg)\n",
            file.name, file.description, file.name
        );
    }
    Ok(page)
}

/// The name of a file without its end.
pub fn name_of(path: &Path) -> String {
    path.file_stem().unwrap_or_default().to_string_lossy().into_owned()
}
