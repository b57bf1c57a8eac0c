//! What the top-level modules of a crate import from one another, read from its sources, and the circles in that.
//!
//! A path counts that begins with `crate`, `super`, `self` or the crate's own name. Comments, strings and what is only
//! compiled for tests do not count. A name that the root re-exports belongs to the module that it comes from. The root
//! itself (`lib.rs`, `main.rs`) is no module: it may know all of them.

use std::collections::{BTreeMap, BTreeSet, VecDeque};
use std::fmt;

/// The sources of a crate: each file's path below `src`, with `/`, and its text.
pub(crate) type Sources = BTreeMap<String, String>;

/// One import: a module needs another one, and the place that says so.
#[derive(Clone, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub(crate) struct Tie {
    pub(crate) from: String,
    pub(crate) to: String,
    pub(crate) file: String,
    pub(crate) line: usize,
}

impl fmt::Display for Tie {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{} -> {}: {}:{}", self.from, self.to, self.file, self.line)
    }
}

/// Modules that need one another.
#[derive(Debug, PartialEq, Eq)]
pub(crate) struct Circle {
    pub(crate) modules: BTreeSet<String>,
    /// A shortest way round.
    pub(crate) round: Vec<Tie>,
    /// All that holds it together: for each pair of modules the first place, and how many there are.
    pub(crate) ties: Vec<(Tie, usize)>,
}

impl fmt::Display for Circle {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let names: Vec<&str> = self.modules.iter().map(String::as_str).collect();
        writeln!(f, "circle of {}", names.join(", "))?;
        self.round.iter().try_for_each(|tie| writeln!(f, "    {tie}"))?;
        writeln!(f, "  all that ties it:")?;
        self.ties.iter().try_for_each(|(tie, times)| writeln!(f, "    {tie} ({times} in all)"))
    }
}

/// A word or a sign of a source, and its line.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
struct Token<'a> {
    text: &'a str,
    line: usize,
}

/// The tokens that matter here: words, `::`, and single signs. Comments, strings and characters are left out.
fn tokens(text: &str) -> Vec<Token<'_>> {
    let bytes = text.as_bytes();
    let is_word = |byte: u8| byte.is_ascii_alphanumeric() || byte == b'_' || byte >= 0x80;
    let mut found = Vec::new();
    let (mut at, mut line) = (0, 1);
    while at < bytes.len() {
        let rest = &text[at..];
        let length = match bytes[at] {
            _ if rest.starts_with("//") => rest.find('\n').unwrap_or(rest.len()),
            _ if rest.starts_with("/*") => comment(rest),
            b'"' => string(rest),
            b'\'' => character(rest),
            b'r' | b'b' | b'c' if raw(rest).is_some() => raw(rest).unwrap_or(1),
            byte if is_word(byte) => {
                let length = rest.bytes().position(|byte| !is_word(byte)).unwrap_or(rest.len());
                found.push(Token { text: &rest[..length], line });
                length
            }
            byte => {
                let length = if rest.starts_with("::") { 2 } else { 1 };
                if !byte.is_ascii_whitespace() {
                    found.push(Token { text: &rest[..length], line });
                }
                length
            }
        };
        line += rest[..length].matches('\n').count();
        at += length;
    }
    found
}

/// The length of a comment, with comments in it.
fn comment(text: &str) -> usize {
    let mut depth = 0;
    let mut at = 0;
    while at < text.len() {
        let pair = text.as_bytes().get(at..at + 2);
        match pair {
            Some(b"/*") => depth += 1,
            Some(b"*/") => depth -= 1,
            _ => {
                at += 1;
                continue;
            }
        }
        at += 2;
        if depth == 0 {
            break;
        }
    }
    at.min(text.len())
}

/// The length of a string that begins here.
fn string(text: &str) -> usize {
    let bytes = text.as_bytes();
    let mut at = 1;
    while at < bytes.len() && bytes[at] != b'"' {
        at += if bytes[at] == b'\\' { 2 } else { 1 };
    }
    (at + 1).min(bytes.len())
}

/// The length of a string that begins here with a letter before it, raw or not.
fn raw(text: &str) -> Option<usize> {
    let prefix = ["br", "cr", "r", "b", "c"].into_iter().find(|prefix| {
        let rest = text[prefix.len().min(text.len())..].trim_start_matches('#');
        text.starts_with(prefix) && rest.starts_with('"')
    })?;
    let hashes = text[prefix.len()..].bytes().take_while(|byte| *byte == b'#').count();
    if !prefix.ends_with('r') {
        return (hashes == 0).then(|| prefix.len() + string(&text[prefix.len()..]));
    }
    let begin = prefix.len() + hashes + 1;
    let end = format!("\"{}", "#".repeat(hashes));
    Some(text[begin..].find(&end).map_or(text.len(), |at| begin + at + end.len()))
}

/// The length of a character or of a lifetime's sign.
fn character(text: &str) -> usize {
    let mut chars = text.char_indices().skip(1);
    match chars.next() {
        Some((_, '\\')) => text[2..].char_indices().skip(1).find(|(_, c)| *c == '\'').map_or(1, |(at, _)| at + 3),
        Some((at, first)) if text[at + first.len_utf8()..].starts_with('\'') => at + first.len_utf8() + 1,
        _ => 1,
    }
}

/// What one file says: the paths that it names, each absolute within the crate, and the modules that it declares.
#[derive(Debug, Default)]
struct Read {
    paths: Vec<(Vec<String>, usize)>,
    modules: Vec<Vec<String>>,
    /// Those of its modules that are compiled for tests only.
    tests: Vec<Vec<String>>,
}

/// The path of the module that a file is.
fn module_of(path: &str) -> Vec<String> {
    let stem = path.strip_suffix(".rs").unwrap_or(path);
    let stem = stem.strip_suffix("/mod").unwrap_or(stem);
    if ["lib", "main"].contains(&stem) { vec![] } else { stem.split('/').map(str::to_owned).collect() }
}

struct Reader<'a> {
    tokens: Vec<Token<'a>>,
    at: usize,
    /// The crate's own name, as a path says it.
    name: String,
    /// The module here, and for each level of it that is written in this file the depth of braces outside.
    here: Vec<String>,
    outside: Vec<usize>,
    depth: usize,
    read: Read,
}

impl<'a> Reader<'a> {
    fn new(name: &str, path: &str, text: &'a str) -> Self {
        let name = name.replace('-', "_");
        let (tokens, here) = (tokens(text), module_of(path));
        Self { tokens, at: 0, name, here, outside: Vec::new(), depth: 0, read: Read::default() }
    }

    fn text(&self, ahead: usize) -> &'a str {
        self.tokens.get(self.at + ahead).map_or("", |token| token.text)
    }

    fn read(mut self) -> Read {
        while self.at < self.tokens.len() {
            match self.text(0) {
                "#" if self.text(1) == "[" || self.text(1) == "!" => self.attribute(),
                "mod" if self.text(2) == ";" => {
                    self.read.modules.push(self.child(self.text(1)));
                    self.at += 3;
                }
                "mod" if self.text(2) == "{" => {
                    self.here = self.child(self.text(1));
                    self.outside.push(self.depth);
                    self.depth += 1;
                    self.at += 3;
                }
                "{" => {
                    self.depth += 1;
                    self.at += 1;
                }
                "}" => {
                    self.depth = self.depth.saturating_sub(1);
                    if self.outside.last() == Some(&self.depth) {
                        self.outside.pop();
                        self.here.pop();
                    }
                    self.at += 1;
                }
                // Who may see something is no import.
                "in" if self.at > 0 && self.tokens[self.at - 1].text == "(" => self.skip_to(")"),
                _ if self.begins_a_path() => {
                    let from = self.base();
                    self.tree(from);
                }
                // In the root a path may begin with a module's name.
                "use" if self.here.is_empty() && self.text(1) != "::" => {
                    self.at += 1;
                    if !self.begins_a_path() {
                        self.tree(vec![]);
                    }
                }
                _ => self.at += 1,
            }
        }
        self.read
    }

    fn child(&self, name: &str) -> Vec<String> {
        self.here.iter().cloned().chain([name.to_owned()]).collect()
    }

    fn skip_to(&mut self, sign: &str) {
        while self.at < self.tokens.len() && self.text(0) != sign {
            self.at += 1;
        }
    }

    /// Passes over an attribute, and over what it keeps for tests.
    fn attribute(&mut self) {
        let begin = self.at;
        let mut depth = 0;
        while self.at < self.tokens.len() {
            depth += usize::from(self.text(0) == "[");
            let closes = self.text(0) == "]";
            self.at += 1;
            if closes {
                depth -= 1;
                if depth == 0 {
                    break;
                }
            }
        }
        let words: Vec<&str> = self.tokens[begin..self.at].iter().map(|token| token.text).collect();
        if words.get(2) == Some(&"cfg") && words.contains(&"test") && !words.contains(&"not") {
            self.skip_item();
        }
    }

    fn skip_item(&mut self) {
        let is_use = |reader: &Self| reader.text(0) == "use" || reader.text(0) == "pub";
        let ends_with_a_sign = is_use(self);
        let mut depth = 0_usize;
        while self.at < self.tokens.len() {
            match self.text(0) {
                "mod" if depth == 0 && self.text(2) == ";" => {
                    self.read.modules.push(self.child(self.text(1)));
                    self.read.tests.push(self.child(self.text(1)));
                }
                "{" => depth += 1,
                "}" => {
                    depth = depth.saturating_sub(1);
                    if depth == 0 && !(ends_with_a_sign && self.text(1) == ";") {
                        self.at += 1;
                        return;
                    }
                }
                ";" if depth == 0 => {
                    self.at += 1;
                    return;
                }
                _ => {}
            }
            self.at += 1;
        }
    }

    /// Whether a path begins here that stays within the crate, or at least within its package.
    fn begins_a_path(&self) -> bool {
        let begins = ["crate", "super", "self", &self.name].contains(&self.text(0));
        let goes_on = self.at > 0 && self.tokens[self.at - 1].text == "::";
        begins && self.text(1) == "::" && !goes_on
    }

    /// Passes over what the path begins with, and says where that is.
    fn base(&mut self) -> Vec<String> {
        let mut base = if ["super", "self"].contains(&self.text(0)) { self.here.clone() } else { vec![] };
        while ["crate", "super", "self", &self.name].contains(&self.text(0)) && self.text(1) == "::" {
            if self.text(0) == "super" {
                base.pop();
            }
            self.at += 2;
        }
        base
    }

    /// Reads what follows `from`: a name, names after it, or several in braces.
    fn tree(&mut self, mut from: Vec<String>) {
        let line = self.tokens.get(self.at).map_or(0, |token| token.line);
        loop {
            if self.text(0) == "{" {
                self.at += 1;
                while self.at < self.tokens.len() && self.text(0) != "}" {
                    self.tree(from.clone());
                    // Past `as other`, and the comma.
                    while !["", ",", "}"].contains(&self.text(0)) {
                        self.at += 1;
                    }
                    if self.text(0) == "," {
                        self.at += 1;
                    }
                }
                self.at += 1;
                return;
            }
            if !["self", "*", ""].contains(&self.text(0)) {
                from.push(self.text(0).to_owned());
            }
            self.at += 1;
            if self.text(0) != "::" {
                self.read.paths.push((from, line));
                return;
            }
            self.at += 1;
            // A turbofish ends a path.
            if self.text(0) == "<" {
                self.read.paths.push((from, line));
                return;
            }
        }
    }
}

fn is_root(path: &str) -> bool {
    module_of(path).is_empty()
}

/// What each file of a crate says, without those that are only compiled for tests.
fn read(name: &str, sources: &Sources) -> BTreeMap<String, Read> {
    let mut read: BTreeMap<String, Read> =
        sources.iter().map(|(path, text)| (path.clone(), Reader::new(name, path, text).read())).collect();
    let tests: Vec<Vec<String>> = read.values().flat_map(|read| read.tests.clone()).collect();
    read.retain(|path, _| !tests.iter().any(|test| module_of(path).starts_with(test)));
    read
}

/// What the top-level modules of the crate import from one another.
pub(crate) fn ties(name: &str, sources: &Sources) -> Vec<Tie> {
    let read = read(name, sources);
    let modules: BTreeSet<&str> = read.keys().filter_map(|path| path.split(['/', '.']).next()).collect();
    let roots = || read.iter().filter(|(path, _)| is_root(path));
    // What the root re-exports, by its last name.
    let mut exported: BTreeMap<&str, &str> = BTreeMap::new();
    for (path, _) in roots().flat_map(|(_, read)| &read.paths) {
        if let [module, .., name] = &path[..]
            && modules.contains(&**module)
        {
            exported.insert(name, module);
        }
    }
    let mut ties = Vec::new();
    for (file, read) in read.iter().filter(|(path, _)| !is_root(path)) {
        let from = &module_of(file)[0];
        for (path, line) in &read.paths {
            let Some(first) = path.first() else { continue };
            let to = if modules.contains(&**first) { Some(&**first) } else { exported.get(&**first).copied() };
            if let Some(to) = to.filter(|to| to != from) {
                ties.push(Tie { from: from.clone(), to: to.to_owned(), file: file.clone(), line: *line });
            }
        }
    }
    ties.sort();
    ties.dedup();
    ties
}

/// The files that no module declares, and that are therefore not compiled.
pub(crate) fn undeclared(name: &str, sources: &Sources) -> Vec<String> {
    let declared: BTreeSet<Vec<String>> =
        sources.iter().flat_map(|(path, text)| Reader::new(name, path, text).read().modules).collect();
    let is_left_out = |path: &&String| !is_root(path) && !declared.contains(&module_of(path));
    sources.keys().filter(is_left_out).cloned().collect()
}

/// The circles among these ties: each group of modules that reach one another.
pub(crate) fn circles(ties: &[Tie]) -> Vec<Circle> {
    let mut next: BTreeMap<&str, BTreeMap<&str, Vec<&Tie>>> = BTreeMap::new();
    for tie in ties {
        next.entry(&tie.from).or_default().entry(&tie.to).or_default().push(tie);
    }
    // A shortest way from one module to another; to itself, a shortest way round.
    let way = |from: &str, to: &str| -> Option<Vec<Tie>> {
        let mut came: BTreeMap<&str, &Tie> = BTreeMap::new();
        let mut waiting = VecDeque::from([from]);
        while let Some(module) = waiting.pop_front() {
            for (other, ties) in next.get(module).into_iter().flatten() {
                if came.contains_key(other) {
                    continue;
                }
                came.insert(other, ties[0]);
                if *other == to {
                    let mut way = vec![ties[0].clone()];
                    while way[0].from != from {
                        way.insert(0, came[&*way[0].from].clone());
                    }
                    return Some(way);
                }
                waiting.push_back(other);
            }
        }
        None
    };
    let mut circles: Vec<Circle> = Vec::new();
    for module in next.keys() {
        if circles.iter().any(|circle| circle.modules.contains(*module)) || way(module, module).is_none() {
            continue;
        }
        let reaches_back = |other: &&&str| way(module, other).is_some() && way(other, module).is_some();
        let modules: BTreeSet<String> = next.keys().filter(reaches_back).map(|name| (*name).to_owned()).collect();
        let rounds = modules.iter().filter_map(|module| way(module, module));
        let round = rounds.min_by_key(Vec::len).unwrap_or_default();
        let pairs = next.values().flat_map(BTreeMap::values);
        let within = pairs.filter(|ties| modules.contains(&ties[0].from) && modules.contains(&ties[0].to));
        let ties = within.map(|ties| (ties[0].clone(), ties.len())).collect();
        circles.push(Circle { modules, round, ties });
    }
    circles
}

fn sources(files: &[(&str, &str)]) -> Sources {
    files.iter().map(|(path, text)| ((*path).to_owned(), (*text).to_owned())).collect()
}

/// The ties of a made-up crate, as they are shown.
fn shown(files: &[(&str, &str)]) -> Vec<String> {
    ties("made-up", &sources(files)).iter().map(Tie::to_string).collect()
}

#[test]
fn every_way_to_name_a_module_is_an_import() {
    let bodies = [
        "use crate::b::C;",
        "use crate::{b::C, b};",
        "use crate::{\n    b::{self, C as D},\n};",
        "pub(crate) use super::b::C;",
        "fn f() { let x = crate::b::c::<u8>(); }",
        "type T = <crate::b::C as Iterator>::Item;",
        "use made_up::b::C;",
        "mod inner { use super::super::b::C; }",
        "const A: &str = \"'\"; const B: char = '\"'; use crate::b;",
        "fn f<'a>(x: &'a str) -> crate::b::C<'a> {}",
        "/* /* */ */ use self::super::b::C;",
        "use crate::C;",
    ];
    for body in bodies {
        let files = [("lib.rs", "mod a;\npub mod b;\npub use b::C;"), ("a.rs", body), ("b.rs", "")];
        let line = if body.contains('\n') { 2 } else { 1 };
        assert_eq!(shown(&files), [format!("a -> b: a.rs:{line}")], "{body}");
    }
}

#[test]
fn what_is_no_import_of_another_module_does_not_count() {
    let bodies = [
        "// use crate::b::C;\n/// [b](crate::b)\n/* crate::b */",
        "const A: &str = \"crate::b::C\"; const B: &str = r#\"\"crate::b::C\"#; const D: &[u8] = b\"crate::b\";",
        "#[cfg(test)]\nmod tests {\n    use crate::b::C;\n    fn f() {}\n}",
        "#[cfg(test)]\nuse crate::{b::C};\n#[cfg(test)]\nmod tests;",
        "#[cfg(all(test, unix))]\n#[allow(unused)]\npub(super) fn f() -> crate::b::C {}",
        "use super::a::D; use self::inner::E; use crate::a; use crate::F; use other::b::C; use crate::*;",
        "pub(in crate::b) struct A;",
        "mod inner { use super::b::C; }",
        "fn f() { other::crate_b::x(); x.super_b(); }",
    ];
    for body in bodies {
        let files = [
            ("lib.rs", "mod a;\nmod b;\nstruct F;"),
            ("a/mod.rs", body),
            ("a/tests.rs", "use crate::b;"),
            ("b.rs", ""),
        ];
        // A file of tests is there where it is declared.
        let files = if body.contains("mod tests;") { &files[..] } else { &[files[0], files[1], files[3]][..] };
        assert_eq!(shown(files), [""; 0], "{body}");
    }
}

#[test]
fn folders_that_need_one_another_are_a_circle_and_it_is_shown_what_ties_it() {
    let tree = sources(&[
        ("lib.rs", "mod rig; mod trace; mod play; mod report; mod leaf;"),
        ("rig/mod.rs", "mod file;"),
        ("rig/file.rs", "\nuse crate::leaf::L;\nuse crate::play::P;"),
        ("trace/mod.rs", "mod decode;"),
        ("trace/decode.rs", "use crate::rig::file::F;\nuse super::super::rig;"),
        ("play.rs", "use crate::trace::T;\nuse crate::leaf::L;"),
        ("report.rs", "use crate::rig::R;"),
        ("leaf.rs", ""),
    ]);
    let circles = circles(&ties("made-up", &tree));
    assert_eq!(circles.len(), 1, "{circles:?}");
    let expected = "circle of play, rig, trace
    play -> trace: play.rs:1
    trace -> rig: trace/decode.rs:1
    rig -> play: rig/file.rs:3
  all that ties it:
    play -> trace: play.rs:1 (1 in all)
    rig -> play: rig/file.rs:3 (1 in all)
    trace -> rig: trace/decode.rs:1 (2 in all)
";
    assert_eq!(circles[0].to_string(), expected);
}

#[test]
fn two_circles_are_two_and_what_only_leads_into_one_is_none_of_it() {
    let tie = |(from, to): (&str, &str)| Tie { from: from.into(), to: to.into(), file: format!("{from}.rs"), line: 1 };
    let pairs =
        [("a", "b"), ("b", "a"), ("c", "d"), ("d", "e"), ("e", "c"), ("e", "d"), ("x", "a"), ("b", "c"), ("d", "y")];
    let ties: Vec<Tie> = pairs.map(tie).into();
    let found: Vec<(Vec<String>, usize)> =
        circles(&ties).into_iter().map(|circle| (circle.modules.into_iter().collect(), circle.round.len())).collect();
    let names = |names: &[&str]| names.iter().map(|name| (*name).to_owned()).collect::<Vec<_>>();
    assert_eq!(found, [(names(&["a", "b"]), 2), (names(&["c", "d", "e"]), 2)]);
    assert_eq!(circles(&pairs[5..].iter().copied().map(tie).collect::<Vec<_>>()), []);
}

#[test]
fn a_file_that_no_module_declares_is_found() {
    let tree = sources(&[
        ("lib.rs", "mod a; // mod c;\n#[cfg(test)]\nmod tests;"),
        ("a/mod.rs", "pub mod b;"),
        ("a/b.rs", ""),
        ("a/d.rs", ""),
        ("c.rs", ""),
        ("tests.rs", ""),
    ]);
    assert_eq!(undeclared("made-up", &tree), ["a/d.rs", "c.rs"]);
}
