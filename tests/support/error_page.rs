//! The book's page of errors, read from the source: every complaint that the program can make, with its remedy.
//!
//! A complaint is made in one place, `Complaint`, by its constructors, by `Gathered::complain`, or by a small helper around them. The source is parsed,
//! the helpers are recognised by what they hand on, and each call's two texts are taken as they stand: a blank that is filled in at run time becomes an ellipsis.

use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};

use syn::visit::{self, Visit};
use syn::{Expr, ExprCall, ExprMethodCall, FnArg, Pat, Stmt};

/// What stands for something filled in at run time.
const BLANK: &str = "\u{2026}";

/// Folders of the source, in the order of the page, with their headings.
const CHAPTERS: [(&str, &str, &str); 12] = [
    ("layout", "The layout", "Found by every command before anything else happens, all of them at once."),
    ("robot", "Robot descriptions", ""),
    ("geometry", "Lenses and rotations", ""),
    ("recording", "The files of the recording", ""),
    ("detect", "Pictures", ""),
    ("frames", "The frame tree", ""),
    ("initialise", "Starting values", ""),
    ("solve", "Solving", ""),
    ("simulate", "Simulating", ""),
    ("print", "Printing targets", ""),
    ("export", "Exporting and reporting", ""),
    ("workflow", "Commands", ""),
];

/// Which chapter a file belongs to.
fn chapter(file: &Path, source: &Path) -> &'static str {
    let inside = file.strip_prefix(source).unwrap();
    let first = inside.components().next().unwrap().as_os_str().to_str().unwrap();
    let known = match first {
        "report" => "export",
        "trust" | "identify" => "solve",
        other => other,
    };
    CHAPTERS.iter().find(|(folder, ..)| *folder == known).map_or("workflow", |(folder, ..)| folder)
}

/// Where a helper takes one of the two texts from.
#[derive(Clone, Debug)]
enum Source {
    /// Its own parameter.
    Parameter(usize),
    /// Always the same.
    Texts(Vec<String>),
}

/// Helpers by how they are called, `f(..)` or `.f(..)`: what, remedy.
type Helpers = BTreeMap<String, (Source, Source)>;

/// Reads one function after the other.
struct Reader<'a> {
    helpers: &'a Helpers,
    /// `#[error("...")]` by variant.
    variants: &'a BTreeMap<String, String>,
    constants: &'a BTreeMap<String, Vec<String>>,
    /// Functions that are one `match`, by name.
    functions: &'a BTreeMap<String, syn::ExprMatch>,
    /// Texts bound by `let` in the function being read.
    bound: Vec<BTreeMap<String, Vec<String>>>,
    /// The same as expressions, where they are a `match`.
    matches: Vec<BTreeMap<String, syn::ExprMatch>>,
    /// Parameters of the function or closure being read, by name.
    parameters: Vec<Vec<String>>,
    /// The functions and closures being read.
    names: Vec<Name>,
    found: BTreeSet<(String, String)>,
    new_helpers: Helpers,
    new_closures: Helpers,
}

/// A function or closure, as callers see it.
#[derive(Clone)]
struct Name {
    keys: Vec<String>,
    /// Known in its own file only.
    closure: bool,
}

/// A format string with its blanks shown.
fn blanks(text: &str) -> String {
    let mut out = String::new();
    let mut rest = text;
    while let Some(at) = rest.find(['{', '}']) {
        out.push_str(&rest[..at]);
        let two = &rest[at..(at + 2).min(rest.len())];
        if two == "{{" || two == "}}" {
            out.push_str(&two[..1]);
            rest = &rest[at + 2..];
            continue;
        }
        out.push_str(BLANK);
        rest = rest[at..].find('}').map_or("", |end| &rest[at + end + 1..]);
    }
    out + rest
}

impl Reader<'_> {
    fn block(&self, block: &syn::Block) -> Vec<String> {
        match block.stmts.last() {
            Some(Stmt::Expr(expr, None)) => self.texts(expr),
            _ => vec![BLANK.to_owned()],
        }
    }

    /// What an expression of text may be.
    fn texts(&self, expr: &Expr) -> Vec<String> {
        match expr {
            Expr::Lit(syn::ExprLit { lit: syn::Lit::Str(text), .. }) => vec![text.value()],
            Expr::Macro(call) if call.mac.path.is_ident("format") => {
                let first = call.mac.tokens.clone().into_iter().next().map(|token| token.to_string());
                let literal = first.and_then(|first| syn::parse_str::<syn::LitStr>(&first).ok());
                vec![literal.map_or_else(|| BLANK.to_owned(), |text| blanks(&text.value()))]
            }
            Expr::Reference(inner) => self.texts(&inner.expr),
            Expr::Paren(inner) => self.texts(&inner.expr),
            Expr::Group(inner) => self.texts(&inner.expr),
            Expr::MethodCall(call)
                if ["to_owned", "into", "to_string", "clone", "as_str"].contains(&call.method.to_string().as_str()) =>
            {
                self.texts(&call.receiver)
            }
            Expr::MethodCall(call) if call.method == "map_or_else" || call.method == "map_or" => {
                let closed = |arg: &Expr| match arg {
                    Expr::Closure(closure) => self.texts(&closure.body),
                    other => self.texts(other),
                };
                call.args.iter().flat_map(closed).collect()
            }
            Expr::Block(block) => self.block(&block.block),
            Expr::If(one) => {
                let mut all = self.block(&one.then_branch);
                all.extend(one.else_branch.iter().flat_map(|(_, other)| self.texts(other)));
                all
            }
            Expr::Match(one) => one.arms.iter().flat_map(|arm| self.texts(&arm.body)).collect(),
            Expr::Path(path) => {
                let name = path.path.segments.last().map(|segment| segment.ident.to_string()).unwrap_or_default();
                let bound = self.bound.iter().rev().find_map(|scope| scope.get(&name));
                bound.or_else(|| self.constants.get(&name)).cloned().unwrap_or_else(|| vec![BLANK.to_owned()])
            }
            _ => vec![BLANK.to_owned()],
        }
    }

    /// Where a text of a helper comes from.
    fn source(&self, expr: &Expr) -> Source {
        let inner = match expr {
            Expr::MethodCall(call) if call.method == "into" || call.method == "to_owned" => &call.receiver,
            other => other,
        };
        if let (Expr::Path(path), Some(parameters)) = (inner, self.parameters.last()) {
            let place = path.path.get_ident().and_then(|name| parameters.iter().position(|known| name == known));
            if let Some(place) = place {
                return Source::Parameter(place);
            }
        }
        Source::Texts(self.texts(expr))
    }

    fn complaint(&mut self, what: &Expr, remedy: &Expr) {
        let sources = (self.source(what), self.source(remedy));
        let handed_on = matches!(sources.0, Source::Parameter(_)) || matches!(sources.1, Source::Parameter(_));
        if handed_on {
            self.hand_on(&sources);
            return;
        }
        self.put(what, remedy);
    }

    /// Remembers that the function being read is a helper.
    fn hand_on(&mut self, sources: &(Source, Source)) {
        let Some(name) = self.names.last().cloned() else { return };
        let known = if name.closure { &mut self.new_closures } else { &mut self.new_helpers };
        known.extend(name.keys.into_iter().map(|key| (key, sources.clone())));
    }

    /// Takes a pair down. An error's variants are paired with the arms of the match that finds their remedies.
    fn put(&mut self, what: &Expr, remedy: &Expr) {
        let whats = self.texts(what);
        let chosen = match remedy {
            Expr::Match(one) => Some(one.clone()),
            Expr::Path(path) => path
                .path
                .get_ident()
                .and_then(|name| self.matches.iter().rev().find_map(|scope| scope.get(&name.to_string())).cloned()),
            Expr::Call(call) => match &*call.func {
                Expr::Path(path) => {
                    path.path.get_ident().and_then(|name| self.functions.get(&name.to_string())).cloned()
                }
                _ => None,
            },
            _ => None,
        };
        if let (Some(one), true) = (chosen, whats.iter().all(|text| text == BLANK)) {
            let mut pairs = Vec::new();
            for arm in &one.arms {
                let name = variant(&arm.pat);
                if let Some(text) = name.and_then(|name| self.variants.get(&name)) {
                    pairs.extend(self.texts(&arm.body).into_iter().map(|remedy| (text.clone(), remedy)));
                }
            }
            self.found.extend(pairs);
            return;
        }
        self.pair(whats, self.texts(remedy));
    }

    fn pair(&mut self, whats: Vec<String>, remedies: Vec<String>) {
        // A word alone is the name of a thing, taken for a sentence.
        let known = |text: &String| text.contains(' ') && text.chars().any(char::is_alphabetic);
        let whats: Vec<String> = whats.into_iter().filter(known).collect();
        // Texts chosen by the same condition belong together.
        let same = whats.len() == remedies.len();
        for (i, what) in whats.iter().enumerate() {
            for (_, remedy) in remedies.iter().enumerate().filter(|(j, _)| !same || i == *j) {
                self.found.insert((what.clone(), remedy.clone()));
            }
        }
    }

    fn call(&mut self, name: &str, args: &[&Expr]) {
        let Some((what, remedy)) = self.helpers.get(name).cloned() else { return };
        let get = |reader: &Self, source: &Source| match source {
            Source::Texts(texts) => Some(texts.clone()),
            Source::Parameter(place) => args.get(*place).map(|arg| reader.texts(arg)),
        };
        // A helper may hand its own parameters on to another.
        let own = |reader: &Self, source: &Source| match source {
            Source::Texts(texts) => Source::Texts(texts.clone()),
            Source::Parameter(place) => args.get(*place).map_or(Source::Texts(vec![]), |arg| reader.source(arg)),
        };
        let sources = (own(self, &what), own(self, &remedy));
        if matches!(sources.0, Source::Parameter(_)) || matches!(sources.1, Source::Parameter(_)) {
            self.hand_on(&sources);
            return;
        }
        if let (Some(whats), Some(remedies)) = (get(self, &what), get(self, &remedy)) {
            self.pair(whats, remedies);
        }
    }

    fn inside(&mut self, name: Name, parameters: Vec<String>, read: impl FnOnce(&mut Self)) {
        self.names.push(name);
        self.parameters.push(parameters);
        self.bound.push(BTreeMap::new());
        self.matches.push(BTreeMap::new());
        read(self);
        self.matches.pop();
        self.bound.pop();
        self.parameters.pop();
        self.names.pop();
    }
}

/// The last word of a pattern's path.
fn variant(pattern: &Pat) -> Option<String> {
    let path = match pattern {
        Pat::TupleStruct(one) => &one.path,
        Pat::Struct(one) => &one.path,
        Pat::Path(one) => &one.path,
        Pat::Ident(one) => return Some(one.ident.to_string()),
        _ => return None,
    };
    path.segments.last().map(|segment| segment.ident.to_string())
}

fn parameter_name(pattern: &Pat) -> String {
    match pattern {
        Pat::Ident(one) => one.ident.to_string(),
        Pat::Type(one) => parameter_name(&one.pat),
        _ => String::new(),
    }
}

fn parameters(signature: &syn::Signature) -> Vec<String> {
    let typed = signature.inputs.iter().filter_map(|input| match input {
        FnArg::Typed(one) => Some(parameter_name(&one.pat)),
        FnArg::Receiver(_) => None,
    });
    typed.collect()
}

/// Tests say what they like.
fn is_test(attributes: &[syn::Attribute]) -> bool {
    attributes.iter().any(|attribute| {
        attribute.path().is_ident("test")
            || attribute.path().is_ident("cfg") && attribute.parse_args::<syn::Path>().is_ok_and(|p| p.is_ident("test"))
    })
}

impl<'ast> Visit<'ast> for Reader<'_> {
    fn visit_item_mod(&mut self, item: &'ast syn::ItemMod) {
        if !is_test(&item.attrs) {
            visit::visit_item_mod(self, item);
        }
    }

    fn visit_item_fn(&mut self, item: &'ast syn::ItemFn) {
        if !is_test(&item.attrs) {
            let name = Name { keys: vec![format!("{}()", item.sig.ident)], closure: false };
            self.inside(name, parameters(&item.sig), |reader| visit::visit_item_fn(reader, item));
        }
    }

    fn visit_impl_item_fn(&mut self, item: &'ast syn::ImplItemFn) {
        let keys = vec![format!("{}()", item.sig.ident), format!(".{}()", item.sig.ident)];
        self.inside(Name { keys, closure: false }, parameters(&item.sig), |reader| {
            visit::visit_impl_item_fn(reader, item)
        });
    }

    fn visit_local(&mut self, local: &'ast syn::Local) {
        let Some(init) = &local.init else { return };
        if let (Pat::Ident(name), Expr::Closure(closure)) = (&local.pat, &*init.expr) {
            let own = closure.inputs.iter().map(parameter_name).collect();
            let name = Name { keys: vec![format!("{}()", name.ident)], closure: true };
            self.inside(name, own, |reader| reader.visit_expr(&closure.body));
            return;
        }
        visit::visit_local(self, local);
        if let (Pat::Ident(name), Expr::Match(one), Some(scope)) = (&local.pat, &*init.expr, self.matches.last_mut()) {
            scope.insert(name.ident.to_string(), one.clone());
        }
        let pairs = match (&local.pat, &*init.expr) {
            (Pat::Ident(name), expr) => vec![(name.ident.to_string(), self.texts(expr))],
            // `let (what, remedy) = match ...`: the alternatives stay in step.
            (Pat::Tuple(names), expr) => {
                let rows = tuples(expr);
                let column = |i: usize| {
                    rows.iter().flat_map(|row| row.elems.iter().nth(i)).flat_map(|e| self.texts(e)).collect()
                };
                names.elems.iter().enumerate().map(|(i, name)| (parameter_name(name), column(i))).collect()
            }
            _ => Vec::new(),
        };
        if let Some(scope) = self.bound.last_mut() {
            scope.extend(pairs.into_iter().filter(|(_, texts): &(String, Vec<String>)| !texts.is_empty()));
        }
    }

    fn visit_expr_call(&mut self, call: &'ast ExprCall) {
        visit::visit_expr_call(self, call);
        let Expr::Path(path) = &*call.func else { return };
        let words: Vec<String> = path.path.segments.iter().map(|segment| segment.ident.to_string()).collect();
        let args: Vec<&Expr> = call.args.iter().collect();
        match (&words.iter().map(String::as_str).collect::<Vec<_>>()[..], &args[..]) {
            ([.., "Complaint", "at"], [_, _, what, remedy]) | ([.., "Complaint", "of"], [_, what, remedy]) => {
                self.complaint(what, remedy)
            }
            ([.., name], _) => self.call(&format!("{name}()"), &args),
            _ => {}
        }
    }

    fn visit_expr_method_call(&mut self, call: &'ast ExprMethodCall) {
        visit::visit_expr_method_call(self, call);
        let args: Vec<&Expr> = call.args.iter().collect();
        self.call(&format!(".{}()", call.method), &args);
    }
}

/// The tuples that an expression may be.
fn tuples(expr: &Expr) -> Vec<&syn::ExprTuple> {
    match expr {
        Expr::Tuple(one) => vec![one],
        Expr::Match(one) => one.arms.iter().flat_map(|arm| tuples(&arm.body)).collect(),
        Expr::Block(block) => last(&block.block),
        Expr::If(one) => {
            let mut all = last(&one.then_branch);
            all.extend(one.else_branch.iter().flat_map(|(_, other)| tuples(other)));
            all
        }
        _ => Vec::new(),
    }
}

fn last(block: &syn::Block) -> Vec<&syn::ExprTuple> {
    match block.stmts.last() {
        Some(Stmt::Expr(expr, None)) => tuples(expr),
        _ => Vec::new(),
    }
}

/// `#[error("...")]` of every variant, by chapter; texts of constants.
#[derive(Default)]
struct Words {
    variants: BTreeMap<String, String>,
    constants: BTreeMap<String, Vec<String>>,
    functions: BTreeMap<String, syn::ExprMatch>,
}

impl<'ast> Visit<'ast> for Words {
    fn visit_variant(&mut self, variant: &'ast syn::Variant) {
        for attribute in variant.attrs.iter().filter(|attribute| attribute.path().is_ident("error")) {
            let first = attribute.meta.require_list().ok().and_then(|list| list.tokens.clone().into_iter().next());
            if let Some(text) = first.and_then(|token| syn::parse_str::<syn::LitStr>(&token.to_string()).ok()) {
                self.variants.insert(variant.ident.to_string(), blanks(&text.value()));
            }
        }
    }

    fn visit_item_fn(&mut self, item: &'ast syn::ItemFn) {
        if let [Stmt::Expr(Expr::Match(one), None)] = &item.block.stmts[..] {
            self.functions.insert(item.sig.ident.to_string(), one.clone());
        }
    }

    fn visit_item_const(&mut self, item: &'ast syn::ItemConst) {
        if let Expr::Lit(syn::ExprLit { lit: syn::Lit::Str(text), .. }) = &*item.expr {
            self.constants.insert(item.ident.to_string(), vec![text.value()]);
        }
    }
}

fn sources(folder: &Path, all: &mut Vec<PathBuf>) {
    for entry in std::fs::read_dir(folder).unwrap().flatten() {
        if entry.path().is_dir() {
            sources(&entry.path(), all);
        } else if entry.path().extension().is_some_and(|kind| kind == "rs") {
            all.push(entry.path());
        }
    }
    all.sort();
}

/// What is wrong and what to do, by chapter.
type Complaints = BTreeMap<&'static str, BTreeSet<(String, String)>>;

/// Every complaint with its remedy, and the errors of the library whose remedy depends on who asked, by chapter.
fn complaints() -> (Complaints, BTreeMap<&'static str, BTreeSet<String>>) {
    let source = Path::new(env!("CARGO_MANIFEST_DIR")).join("src");
    let mut paths = Vec::new();
    sources(&source, &mut paths);
    let files: Vec<(PathBuf, syn::File)> = paths
        .into_iter()
        .map(|path| {
            let text = std::fs::read_to_string(&path).unwrap();
            let file = syn::parse_file(&text).unwrap_or_else(|e| panic!("{}: {e}", path.display()));
            (path, file)
        })
        .collect();
    let mut words = Words::default();
    for (_, file) in &files {
        words.visit_file(file);
    }
    let mut shared: Helpers =
        [(".complain()".to_owned(), (Source::Parameter(1), Source::Parameter(2)))].into_iter().collect();
    let mut all: Complaints = BTreeMap::new();
    // A helper may be called in a file that is read before its own, and by another helper.
    for last in [false, false, true] {
        for (path, file) in &files {
            let mut own = shared.clone();
            for round in 0..3 {
                let mut reader = Reader {
                    helpers: &own,
                    variants: &words.variants,
                    constants: &words.constants,
                    functions: &words.functions,
                    bound: vec![BTreeMap::new()],
                    matches: vec![BTreeMap::new()],
                    parameters: Vec::new(),
                    names: Vec::new(),
                    found: BTreeSet::new(),
                    new_helpers: BTreeMap::new(),
                    new_closures: BTreeMap::new(),
                };
                reader.visit_file(file);
                let (found, helpers, closures) = (reader.found, reader.new_helpers, reader.new_closures);
                if last && round == 2 {
                    all.entry(chapter(path, &source)).or_default().extend(found);
                }
                shared.extend(helpers.clone());
                own.extend(helpers);
                own.extend(closures);
            }
        }
    }
    let paired: BTreeSet<String> = all.values().flatten().map(|(what, _)| what.clone()).collect();
    let mut rest: BTreeMap<&'static str, BTreeSet<String>> = BTreeMap::new();
    for (path, file) in &files {
        let mut own = Words::default();
        own.visit_file(file);
        let texts = own.variants.into_values().filter(|text| !paired.contains(text));
        rest.entry(chapter(path, &source)).or_default().extend(texts);
    }
    (all, rest)
}

/// The page.
pub fn page() -> String {
    let (all, rest) = complaints();
    let mut text = String::from(
        "# Every error\n\n<!-- Written by `cargo run --release --example error_page > docs/src/errors.md` from the source. -->\n\n\
         Wrong input ends a command with exit code 2 and, for each thing that is wrong, the file, the line, what is wrong, and what to do. These are all of\n\
         them; `\u{2026}` stands for what is filled in. With `--json` they come as `{errors: [{file, line, what, remedy}]}`.\n",
    );
    let cell =
        |text: &str| text.split_whitespace().collect::<Vec<_>>().join(" ").replace('|', "\\|").replace('<', "&lt;");
    for (folder, heading, words) in CHAPTERS {
        let pairs = all.get(folder).cloned().unwrap_or_default();
        let alone = rest.get(folder).cloned().unwrap_or_default();
        if pairs.is_empty() && alone.is_empty() {
            continue;
        }
        text.push_str(&format!("\n## {heading}\n"));
        if !words.is_empty() {
            text.push_str(&format!("\n{words}\n"));
        }
        if !pairs.is_empty() {
            text.push_str("\n| what is wrong | what to do |\n|---|---|\n");
        }
        for (what, remedy) in pairs {
            text.push_str(&format!("| {} | {} |\n", cell(&what), cell(&remedy)));
        }
        if !alone.is_empty() {
            text.push_str("\nWith a remedy that depends on where it happens:\n\n");
        }
        for what in alone {
            text.push_str(&format!("- {}\n", cell(&what)));
        }
    }
    text
}
