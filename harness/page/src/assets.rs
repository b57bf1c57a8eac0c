//! What a browser loads: each in a file of its own, and all of it in the program.

/// The page itself.
pub(crate) const PAGE: &str = "page.html";

const HTML: &str = "text/html; charset=utf-8";
const STYLE: &str = "text/css; charset=utf-8";
const SCRIPT: &str = "text/javascript; charset=utf-8";

macro_rules! assets {
    ($($kind:ident $name:literal),* $(,)?) => {
        const ASSETS: &[(&str, &str, &str)] = &[$(($name, $kind, include_str!(concat!("../assets/", $name)))),*];
    };
}

assets! {
    HTML "page.html",
    STYLE "style.css",
    STYLE "parts.css",
    SCRIPT "main.js",
    SCRIPT "texts.js",
    SCRIPT "words.js",
    SCRIPT "dom.js",
    SCRIPT "model.js",
    SCRIPT "boards.js",
    SCRIPT "charts.js",
    SCRIPT "bus.js",
    SCRIPT "talk.js",
    SCRIPT "status.js",
    SCRIPT "controls.js",
    SCRIPT "faults.js",
    SCRIPT "program.js",
    SCRIPT "preview.js",
    SCRIPT "save.js",
    SCRIPT "machine.js",
    SCRIPT "lathe.js",
    SCRIPT "bed.js",
    SCRIPT "slides.js",
    SCRIPT "past.js",
}

/// The kind and the content of what has this name.
pub(crate) fn asset(name: &str) -> Option<(&'static str, &'static str)> {
    ASSETS.iter().find(|(other, ..)| *other == name).map(|(_, kind, content)| (*kind, *content))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_loaded_is_there_and_comes_from_nowhere_else() {
        for (name, _, content) in ASSETS {
            let loads = content.split(['"', '\'']).filter(|text| text.ends_with(".js") || text.ends_with(".css"));
            for load in loads {
                let load = load.trim_start_matches("./");
                assert!(asset(load).is_some(), "{name} loads {load}");
            }
            let elsewhere = content.replace("http://www.w3.org/2000/svg", "");
            assert!(!elsewhere.contains("//www.") && !elsewhere.contains("https:"), "{name} loads from elsewhere");
        }
        for (name, ..) in ASSETS.iter().filter(|(name, ..)| *name != PAGE) {
            let loaded = ASSETS.iter().any(|(_, _, content)| content.contains(&format!("{name}\"")));
            assert!(loaded, "nothing loads {name}");
        }
    }

    #[test]
    fn no_asset_is_too_long() {
        for (name, _, content) in ASSETS {
            let lines = content.lines().count();
            assert!(lines <= 300, "{name} has {lines} lines: split it");
            assert!(content.lines().all(|line| line.chars().count() <= 120), "a line of {name} is too long");
        }
    }
}
