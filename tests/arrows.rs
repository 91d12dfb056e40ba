//! The arrows between the folders of `src/`: which part of the program uses which, read from the sources.
//!
//! Every path that begins with `crate` or climbs with `super` is an arrow from the folder that it stands in to the folder that it names.
//! An arrow that is not in the table of the design runs back, and fails. Comments and strings are no paths: the sources are read as tokens.
//! So is what belongs to the command line alone: flags, the parser of arguments, printing.

use proc_macro2::{Delimiter, TokenStream, TokenTree};
use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};

/// Each folder with those that it may use, in the order of the way of the data. `lib.rs` and `main.rs` may use everything.
const ALLOWED: &[(&str, &[&str])] = &[
    ("base", &[]),
    ("scene", &["base"]),
    ("nodes", &["base", "scene"]),
    ("graph", &["base", "scene", "nodes"]),
    ("gpu", &["base", "scene", "nodes", "graph"]),
    ("media", &["base", "scene", "nodes", "graph", "gpu"]),
    ("view", &["base", "scene", "nodes", "graph", "gpu"]),
    ("integrators", &["base", "scene", "nodes", "graph", "gpu", "media", "view"]),
    ("engines", &["base", "scene", "nodes", "graph", "gpu", "media", "view"]),
    ("bridge", &["base", "scene", "nodes", "graph", "media"]),
    ("measure", &["base", "scene", "nodes", "graph", "gpu", "media", "view", "integrators", "engines", "bridge"]),
    (
        "report",
        &["base", "scene", "nodes", "graph", "gpu", "media", "view", "integrators", "engines", "bridge", "measure"],
    ),
    ("viewer", &["base", "scene", "nodes", "graph", "gpu", "media", "view", "integrators", "engines"]),
    (
        "cli",
        &[
            "base",
            "scene",
            "nodes",
            "graph",
            "gpu",
            "media",
            "view",
            "integrators",
            "engines",
            "bridge",
            "measure",
            "report",
            "viewer",
        ],
    ),
];

/// Modules of `measure` that its questions share. Every other one is a question: questions never use each other, and what is shared uses none.
const SHARED: &[&str] = &[
    "combination",
    "domain",
    "errors",
    "evaluators",
    "experiment",
    "images",
    "light_volume",
    "provenance",
    "scenes",
    "seeds",
    "suite",
    "timing",
    "toml_files",
    "truth",
    "voxels",
];

/// The module of a file's own tests. What they use beside it is no arrow of the module: tests may look at what uses it.
const TESTS: &str = "tests";

/// An arrow: from a module path to a module path.
type Arrow = (Vec<String>, Vec<String>);

/// The arrows of a source text that stands at `module`.
fn arrows(text: &str, module: &[String]) -> Vec<Arrow> {
    let tokens: TokenStream = text.parse().expect("a source that compiles");
    let mut found = Vec::new();
    walk(tokens, &mut module.to_vec(), module, &mut found);
    found
}

fn walk(tokens: TokenStream, place: &mut Vec<String>, file: &[String], found: &mut Vec<Arrow>) {
    let tokens: Vec<TokenTree> = tokens.into_iter().collect();
    let mut at = 0;
    while at < tokens.len() {
        let word = |index: usize| match tokens.get(index) {
            Some(TokenTree::Ident(word)) => word.to_string(),
            _ => String::new(),
        };
        // A path that another path leads to is no beginning: `self::crate` does not exist, `a::super` neither.
        let begins = at == 0 || !matches!(&tokens[at - 1], TokenTree::Punct(mark) if mark.as_char() == ':');
        match &tokens[at] {
            TokenTree::Ident(name) if begins && (name == "crate" || name == "super") => {
                let mut base =
                    if name == "crate" { Vec::new() } else { place[..place.len().saturating_sub(1)].to_vec() };
                at = follow(&tokens, at + 1, &mut base, file, found);
                continue;
            }
            TokenTree::Group(group) => {
                // The body of an inline module is one level deeper.
                let is_module = group.delimiter() == Delimiter::Brace && at >= 2 && word(at - 2) == "mod";
                if is_module {
                    place.push(word(at - 1));
                }
                if is_module && word(at - 1) == TESTS {
                    let tests = [file, &[TESTS.to_owned()]].concat();
                    walk(group.stream(), place, &tests, found);
                } else {
                    walk(group.stream(), place, file, found);
                }
                if is_module {
                    place.pop();
                }
            }
            _ => {}
        }
        at += 1;
    }
}

/// Follows `:: a :: {b, c::d}` from the token behind `crate` or `super`; the first token behind it.
fn follow(
    tokens: &[TokenTree],
    mut at: usize,
    base: &mut Vec<String>,
    file: &[String],
    found: &mut Vec<Arrow>,
) -> usize {
    let is_colon = |index: usize| matches!(tokens.get(index), Some(TokenTree::Punct(mark)) if mark.as_char() == ':');
    while is_colon(at) && is_colon(at + 1) {
        match tokens.get(at + 2) {
            Some(TokenTree::Ident(name)) if name == "super" => {
                base.pop();
            }
            Some(TokenTree::Ident(name)) => base.push(name.to_string()),
            Some(TokenTree::Group(group)) => {
                let inner: Vec<TokenTree> = group.stream().into_iter().collect();
                for part in inner.split(|token| matches!(token, TokenTree::Punct(mark) if mark.as_char() == ',')) {
                    let Some(TokenTree::Ident(name)) = part.first() else { continue };
                    let mut branch = base.clone();
                    branch.push(name.to_string());
                    follow(part, 1, &mut branch, file, found);
                }
                return at + 3;
            }
            _ => break,
        }
        at += 3;
    }
    if !base.is_empty() {
        found.push((file.to_vec(), base.clone()));
    }
    at
}

/// What a folder may use, or none for a name that is no folder.
fn allowed(folder: &str) -> Option<&'static [&'static str]> {
    ALLOWED.iter().find(|(name, _)| *name == folder).map(|(_, uses)| *uses)
}

/// The arrows that run back, as text.
fn backwards(arrows: &[Arrow]) -> BTreeSet<String> {
    let mut wrong = BTreeSet::new();
    for (from, to) in arrows {
        let (Some(uses), [to_folder, ..]) = (allowed(&from[0]), to.as_slice()) else { continue };
        // Names of the root that are no folder: the error type and its result.
        if allowed(to_folder).is_some() && *to_folder != from[0] && !uses.contains(&to_folder.as_str()) {
            wrong.insert(format!("{} -> {}", from.join("::"), to.join("::")));
        }
    }
    wrong
}

/// Arrows within `measure` to a question from another question or from what they share, as text.
fn between_questions(arrows: &[Arrow]) -> BTreeSet<String> {
    let mut wrong = BTreeSet::new();
    for (from, to) in arrows {
        let ([a, from_module, ..], [b, to_module, ..]) = (from.as_slice(), to.as_slice()) else { continue };
        let is_question = !SHARED.contains(&to_module.as_str());
        if a == "measure" && b == "measure" && from_module != to_module && is_question {
            wrong.insert(format!("{} -> {}", from.join("::"), to.join("::")));
        }
    }
    wrong
}

/// The arrows between modules of one folder that lie on a circle, as text. A folder stands for all that is in it, and its own file is in no
/// circle with what it holds: it says what they share and lists them.
fn circles(arrows: &[Arrow], modules: &BTreeSet<Vec<String>>) -> BTreeSet<String> {
    let mut uses: BTreeMap<&[String], BTreeSet<&[String]>> = BTreeMap::new();
    for (from, to) in arrows.iter().filter(|(from, _)| from.last().is_none_or(|last| last != TESTS)) {
        // Where the two paths part.
        let common = from.iter().zip(to).take_while(|(from, to)| from == to).count();
        if common < from.len() && common < to.len() && modules.contains(&to[..=common]) {
            uses.entry(&from[..=common]).or_default().insert(&to[..=common]);
        }
    }
    let reaches = |start: &[String], end: &[String]| {
        let mut seen: BTreeSet<&[String]> = BTreeSet::new();
        let mut open = vec![start];
        while let Some(next) = open.pop() {
            if seen.insert(next) {
                open.extend(uses.get(next).into_iter().flatten());
            }
        }
        seen.contains(end)
    };
    let all = uses.iter().flat_map(|(from, to)| to.iter().map(|to| (*from, *to)));
    all.filter(|(from, to)| reaches(to, from))
        .map(|(from, to)| format!("{} -> {}", from.join("::"), to.join("::")))
        .collect()
}

/// What a source holds that belongs to the command line alone, as tokens: flags in strings and comments, the parser, printing.
fn of_the_command_line(tokens: TokenStream, found: &mut Vec<String>) {
    let tokens: Vec<TokenTree> = tokens.into_iter().collect();
    for (number, token) in tokens.iter().enumerate() {
        match token {
            // A comment of documentation is a literal, too.
            TokenTree::Literal(literal) => {
                let text = literal.to_string();
                let is_flag = |at: usize| text[at + 2..].starts_with(|letter: char| letter.is_ascii_lowercase());
                if text.match_indices("--").any(|(at, _)| is_flag(at)) {
                    found.push(text);
                }
            }
            TokenTree::Ident(word) if word == "clap" => found.push(word.to_string()),
            TokenTree::Ident(word) => {
                let is_macro = matches!(tokens.get(number + 1), Some(TokenTree::Punct(mark)) if mark.as_char() == '!');
                let word = word.to_string();
                if is_macro && ["print", "println", "eprint", "eprintln", "dbg"].contains(&word.as_str()) {
                    found.push(format!("{word}!"));
                }
            }
            TokenTree::Group(group) => of_the_command_line(group.stream(), found),
            TokenTree::Punct(_) => {}
        }
    }
}

fn sources(folder: &Path) -> Vec<PathBuf> {
    let mut found = Vec::new();
    for entry in std::fs::read_dir(folder).expect("a folder of sources") {
        let path = entry.expect("an entry").path();
        // A program that bundles carry is none of ours.
        if path.ends_with("bundle/wgsl/rust") {
            continue;
        }
        if path.is_dir() {
            found.extend(sources(&path));
        } else if path.extension().is_some_and(|kind| kind == "rs") {
            found.push(path);
        }
    }
    found.sort();
    found
}

/// Module path of a source file below `src/`.
fn module_of(path: &Path, root: &Path) -> Vec<String> {
    let inside = path.strip_prefix(root).expect("a file below the root").with_extension("");
    let mut parts: Vec<String> = inside.iter().map(|part| part.to_string_lossy().into_owned()).collect();
    if parts.last().is_some_and(|last| last == "mod") {
        parts.pop();
    }
    parts
}

/// All arrows, and all modules.
fn all_arrows() -> (Vec<Arrow>, BTreeSet<Vec<String>>) {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("src");
    let (mut found, mut modules) = (Vec::new(), BTreeSet::new());
    for path in sources(&root) {
        let module = module_of(&path, &root);
        if allowed(&module[0]).is_none() {
            assert!(matches!(module[0].as_str(), "lib" | "main"), "{} is in no folder of the table", path.display());
            continue;
        }
        found.extend(arrows(&std::fs::read_to_string(&path).expect("a source"), &module));
        // A folder without a file of its own is a module, too.
        modules.extend((1..=module.len()).map(|length| module[..length].to_vec()));
    }
    (found, modules)
}

#[test]
fn no_arrow_runs_back_and_no_module_is_in_a_circle() {
    let (arrows, modules) = all_arrows();
    assert!(arrows.len() > 1000, "the sources were read: {} arrows", arrows.len());
    let mut table: BTreeMap<(&str, &str), usize> = BTreeMap::new();
    for (from, to) in arrows.iter().filter(|(from, to)| allowed(&to[0]).is_some() && from[0] != to[0]) {
        *table.entry((&from[0], &to[0])).or_default() += 1;
    }
    for (folder, _) in ALLOWED {
        let uses: Vec<String> = table
            .iter()
            .filter(|((from, _), _)| from == folder)
            .map(|((_, to), count)| format!("{to} ({count})"))
            .collect();
        println!("{folder:12} uses {}", if uses.is_empty() { "nothing".into() } else { uses.join(", ") });
    }
    assert_eq!(backwards(&arrows), BTreeSet::new(), "arrows that run back");
    let found = circles(&arrows, &modules);
    assert!(found.is_empty(), "modules in a circle: {found:#?}");
}

#[test]
fn questions_of_measure_never_use_each_other() {
    let (arrows, _) = all_arrows();
    let modules: BTreeSet<&str> = arrows
        .iter()
        .filter(|(from, _)| from[0] == "measure" && from.len() > 1)
        .map(|(from, _)| from[1].as_str())
        .collect();
    // Names that are not there any more would hide a question of the same name.
    for name in SHARED {
        assert!(
            modules.contains(name) || std::path::Path::new("src/measure").join(format!("{name}.rs")).exists(),
            "{name}"
        );
    }
    let questions: Vec<&&str> = modules.iter().filter(|name| !SHARED.contains(name)).collect();
    println!("questions: {questions:?}");
    assert!(questions.len() >= 9, "{questions:?}");
    assert_eq!(between_questions(&arrows), BTreeSet::new(), "arrows between questions");
}

#[test]
fn the_table_itself_has_no_circle() {
    for (number, (folder, uses)) in ALLOWED.iter().enumerate() {
        let before: Vec<&str> = ALLOWED[..number].iter().map(|(name, _)| *name).collect();
        assert!(uses.iter().all(|used| before.contains(used)), "{folder} uses what stands behind it");
    }
}

#[test]
fn a_planted_arrow_that_runs_back_is_found() {
    let module: Vec<String> = ["nodes", "math"].map(str::to_owned).to_vec();
    for (text, wanted) in [
        ("use crate::graph::Program;", "nodes::math -> graph::Program"),
        ("use crate::{base::error::Error, report::{numbers, tables}};", "nodes::math -> report::numbers"),
        ("fn f() { let x = crate::gpu::Gpu::open(); }", "nodes::math -> gpu::Gpu::open"),
        ("use super::super::cli;", "nodes::math -> cli"),
        ("mod tests { use super::super::super::view::camera; }", "nodes::math::tests -> view::camera"),
        ("pub(crate) use crate::engines as parts;", "nodes::math -> engines"),
    ] {
        let wrong = backwards(&arrows(text, &module));
        assert!(wrong.contains(wanted), "{text}: {wrong:?}");
    }
    for text in [
        "use crate::scene::Scene; // crate::graph::Program",
        "const TEXT: &str = \"crate::graph\";",
        "use super::real::Real;",
        "mod tests { use super::*; use super::super::real; }",
        "use crate::Error;",
    ] {
        assert_eq!(backwards(&arrows(text, &module)), BTreeSet::new(), "{text}");
    }
    // Between questions of `measure`, and from what they share to one of them.
    for (place, text, wanted) in [
        ("study", "use crate::measure::tuning::Tuning;", "measure::study -> measure::tuning::Tuning"),
        ("truth", "use super::study::Study;", "measure::truth -> measure::study::Study"),
        ("speed", "use crate::measure::{errors, pictures::parity};", "measure::speed -> measure::pictures::parity"),
    ] {
        let module: Vec<String> = ["measure", place].map(str::to_owned).to_vec();
        assert!(between_questions(&arrows(text, &module)).contains(wanted), "{text}");
    }
    for text in ["use crate::measure::errors::Errors;", "use crate::measure::study::file;", "use super::truth::Truth;"]
    {
        let module: Vec<String> = ["measure", "study"].map(str::to_owned).to_vec();
        assert_eq!(between_questions(&arrows(text, &module)), BTreeSet::new(), "{text}");
    }
}

#[test]
fn a_planted_circle_of_modules_is_found() {
    let path = |text: &str| -> Vec<String> { text.split("::").map(str::to_owned).collect() };
    let found = |sources: &[(&str, &str)]| {
        let planted: Vec<Arrow> = sources.iter().flat_map(|(module, text)| arrows(text, &path(module))).collect();
        let named = ["media::phase", "media::medium", "media::medium::parts", "view::camera", "integrators::path"];
        let named: Vec<Vec<String>> = named.iter().map(|name| path(name)).collect();
        circles(&planted, &named.iter().flat_map(|name| (1..=name.len()).map(|end| name[..end].to_vec())).collect())
    };
    let set = |names: &[&str]| -> BTreeSet<String> { names.iter().map(|name| (*name).to_owned()).collect() };
    // Two folders, each arrow for itself.
    let folders = [("media::phase", "use crate::view::camera::Camera;"), ("view::camera", "use crate::media::phase;")];
    assert_eq!(found(&folders), set(&["media -> view", "view -> media"]));
    assert_eq!(found(&folders[..1]), set(&[]));
    // Two modules of a folder, one of them by its part.
    let modules = [
        ("media::phase", "use crate::media::medium::Medium;"),
        ("media::medium::parts", "fn f() { let x = super::super::phase::lobe(); }"),
    ];
    assert_eq!(found(&modules), set(&["media::medium -> media::phase", "media::phase -> media::medium"]));
    assert_eq!(found(&modules[1..]), set(&[]));
    // The tests of a module are none of it.
    let tested = [modules[1], ("media::phase", "mod tests { use crate::media::medium::Medium; }")];
    assert_eq!(found(&tested), set(&[]));
    // What a folder's own file says is used by all that it holds.
    let shared =
        [("media", "use crate::media::phase::Lobe;"), ("media::phase", "use super::Kind; use crate::media::Name;")];
    assert_eq!(found(&shared), set(&[]));
}

#[test]
fn the_library_knows_no_flag_and_no_parser_of_arguments_and_prints_nothing() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("src");
    let mut wrong = Vec::new();
    let (mut library, mut command_line) = (0, 0);
    for path in sources(&root) {
        let mut found = Vec::new();
        of_the_command_line(std::fs::read_to_string(&path).expect("a source").parse().expect("tokens"), &mut found);
        if matches!(module_of(&path, &root)[0].as_str(), "cli" | "main") {
            command_line += found.len();
            continue;
        }
        library += 1;
        wrong.extend(found.into_iter().map(|text| format!("{}: {text}", path.display())));
    }
    assert!(library > 100 && command_line > 100, "the sources were read: {library} files, {command_line} finds");
    assert_eq!(wrong, Vec::<String>::new(), "what belongs to src/cli");
}

#[test]
fn a_planted_flag_or_parser_or_print_is_found() {
    let found = |text: &str| {
        let mut found = Vec::new();
        of_the_command_line(text.parse().expect("tokens"), &mut found);
        found.len()
    };
    for text in [
        r#"fn f() -> Error { Error::new(place, "0", "1", "Give --backend cpu.") }"#,
        "/// What `--set` takes.\nfn f() {}",
        r##"const TEXT: &str = r#"a "--json" inside"#;"##,
        "#[derive(Debug, clap::ValueEnum)] enum A { B }",
        "use clap::Parser;",
        "mod a { fn f() { if true { eprintln!(\"warning\"); } } }",
        "fn f() { dbg!(1); }",
    ] {
        assert_eq!(found(text), 1, "{text}");
    }
    for text in [
        "// --set is an option\nfn f(n: i32) -> i32 { n - -1 }",
        r#"const RULE: &str = "-- a dash --"; const TABLE: &str = "| --- |";"#,
        "fn println() { writeln!(text, \"a\"); print(text); }",
    ] {
        assert_eq!(found(text), 0, "{text}");
    }
}
