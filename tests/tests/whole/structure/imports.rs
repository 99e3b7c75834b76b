//! Which file of a crate imports what from which: the modules of a crate, read from its sources, and the paths in them.
//!
//! The sources are split into tokens, so that comments and strings say nothing, and paths inside macros count. What only tests
//! compile is left out. A path leads to the file that defines its item: re-exports are followed.

use proc_macro2::{Delimiter, Group, TokenStream, TokenTree};
use std::collections::{BTreeMap, BTreeSet};
use std::str::FromStr as _;

/// The name of a file, relative to the folder of its crate's root, with its text.
pub(super) type Sources = BTreeMap<String, String>;

/// Module names from the crate's root down; the root itself is empty.
pub(super) type Module = Vec<String>;

/// Re-exports that may follow each other before a path is given up as circular.
const MOST_STEPS: usize = 8;

/// A module names something of another module of its crate.
#[derive(Clone, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub(super) struct Import {
    pub(super) from: Module,
    pub(super) to: Module,
    /// Whether the module works with what the other defines. It does not where it only hands a name on, nor where it names the
    /// other as a whole, as in `use crate::numerics;`: what that is used for shows in longer paths.
    pub(super) needed: bool,
}

/// The modules of a crate.
pub(super) struct Crate {
    modules: BTreeMap<Module, Contents>,
}

/// What a module holds.
#[derive(Default)]
struct Contents {
    file: String,
    children: BTreeSet<String>,
    /// Names of functions, types, constants and macros.
    items: BTreeSet<String>,
    uses: Vec<Use>,
    /// Paths of two names and more outside of `use`.
    paths: Vec<Vec<String>>,
    /// Every name outside of `use`.
    named: BTreeSet<String>,
}

/// One name that a `use` brings into a module; `*` stands for all.
struct Use {
    path: Vec<String>,
    name: String,
    /// With a visibility of its own: it may only hand the name on.
    exported: bool,
}

/// Where a path leads.
enum Target {
    /// To an item of a module, or to the module as a whole.
    Inside { module: Module, whole: bool },
    /// Into another crate.
    Outside,
    /// To a name that no declaration shows, such as one that a macro makes.
    Unknown,
}

impl Crate {
    /// Reads the modules that the file of the root declares, and those that they declare.
    pub(super) fn read(root: &str, sources: &Sources) -> Self {
        let mut of = Self { modules: BTreeMap::new() };
        let folder = root.rsplit_once('/').map_or(String::new(), |(folder, _)| format!("{folder}/"));
        of.file(root, Module::new(), &folder, sources);
        of
    }

    /// The file that holds a module.
    pub(super) fn file_of(&self, module: &Module) -> &str {
        &self.modules[module].file
    }

    /// The modules that the root declares: its folders, and files that stand beside them.
    pub(super) fn folders(&self) -> BTreeSet<&str> {
        self.modules.keys().filter(|module| module.len() == 1).map(|module| module[0].as_str()).collect()
    }

    /// `folder` is where files of child modules stand.
    fn file(&mut self, file: &str, module: Module, folder: &str, sources: &Sources) {
        let text = sources.get(file).unwrap_or_else(|| panic!("{file} is not among the sources"));
        let tokens = TokenStream::from_str(text).unwrap_or_else(|error| panic!("{file}: {error}"));
        self.module(tokens, file, module, folder, sources);
    }

    fn module(&mut self, tokens: TokenStream, file: &str, module: Module, folder: &str, sources: &Sources) {
        let mut contents = Contents { file: file.to_owned(), ..Contents::default() };
        let tokens = without_tests(tokens);
        contents.walk(&tokens);
        for (name, body) in modules_in(&tokens) {
            contents.children.insert(name.clone());
            let child = child_of(&module, &name);
            let inner = format!("{folder}{name}/");
            match body {
                Some(body) => self.module(body.stream(), file, child, &inner, sources),
                None => {
                    let beside = format!("{folder}{name}.rs");
                    let file = if sources.contains_key(&beside) { beside } else { format!("{inner}mod.rs") };
                    self.file(&file, child, &inner, sources);
                }
            }
        }
        contents.items = items_in(&tokens);
        self.modules.insert(module, contents);
    }

    /// What every module imports from others.
    pub(super) fn imports(&self) -> BTreeSet<Import> {
        let mut imports = BTreeSet::new();
        for (module, contents) in &self.modules {
            let of_uses = contents.uses.iter().map(|of| (&of.path, !of.exported || contents.named.contains(&of.name)));
            for (path, used) in of_uses.chain(contents.paths.iter().map(|path| (path, true))) {
                if let Target::Inside { module: to, whole } = self.resolve(module, path, 0)
                    && to != *module
                {
                    imports.insert(Import { from: module.clone(), to, needed: used && !whole });
                }
            }
        }
        imports
    }

    /// Where a path that a module writes leads.
    fn resolve(&self, module: &Module, path: &[String], steps: usize) -> Target {
        let special = |name: &&String| ["crate", "super", "self"].contains(&name.as_str());
        let (start, names) = path.split_at(path.iter().take_while(special).count());
        let mut module = module.clone();
        for name in start {
            match name.as_str() {
                "crate" => module.clear(),
                "super" => drop(module.pop()),
                _ => {}
            }
        }
        match self.find(&module, names, steps) {
            // Any first name may be that of another crate.
            Target::Unknown if start.is_empty() => Target::Outside,
            Target::Unknown => Target::Inside { module, whole: false },
            found => found,
        }
    }

    /// Where names lead that stand after a module's.
    fn find(&self, module: &Module, names: &[String], steps: usize) -> Target {
        let Some((name, rest)) = names.split_first() else {
            return Target::Inside { module: module.clone(), whole: true };
        };
        let contents = &self.modules[module];
        if contents.children.contains(name) {
            let child = child_of(module, name);
            return match self.find(&child, rest, steps) {
                Target::Unknown => Target::Inside { module: child, whole: false },
                found => found,
            };
        }
        if name == "*" || contents.items.contains(name) {
            return Target::Inside { module: module.clone(), whole: false };
        }
        if steps == MOST_STEPS {
            return Target::Unknown;
        }
        let named = contents.uses.iter().filter(|of| of.name == *name && of.path != names);
        let exact = named.map(|of| self.resolve(module, &[&of.path[..], rest].concat(), steps + 1));
        let all = contents.uses.iter().filter(|of| of.name == "*").map(|of| {
            match self.resolve(module, &of.path[..of.path.len() - 1], steps + 1) {
                Target::Inside { module: within, .. } if within != *module => self.find(&within, names, steps + 1),
                _ => Target::Unknown,
            }
        });
        exact.chain(all).find(|target| !matches!(target, Target::Unknown)).unwrap_or(Target::Unknown)
    }
}

impl Contents {
    /// Takes in the `use` declarations and the paths of a piece of source, and of everything in brackets but modules.
    fn walk(&mut self, tokens: &[TokenTree]) {
        let mut at = 0;
        let mut variants = false;
        while at < tokens.len() {
            let before = at.checked_sub(1).map(|before| &tokens[before]);
            match &tokens[at] {
                TokenTree::Ident(name) if name == "use" && !is_punct(tokens.get(at + 1), '<') => {
                    let end = (at..tokens.len()).find(|&end| is_punct(tokens.get(end), ';')).unwrap_or(tokens.len());
                    let exported = is_ident(before, "pub") || restricted(tokens, at.wrapping_sub(1));
                    self.used(&tokens[at + 1..end], &[], exported);
                    at = end;
                }
                TokenTree::Ident(name) if name == "mod" => at += 2,
                TokenTree::Ident(name) if name == "enum" => variants = true,
                TokenTree::Ident(_) if !continues(tokens, at) => {
                    let path = path_at(tokens, at);
                    at += 3 * (path.len() - 1);
                    self.named.insert(path[0].clone());
                    if path.len() > 1 {
                        self.paths.push(path);
                    }
                }
                TokenTree::Group(group) if !restricted(tokens, at) && !quoted(tokens, at) => {
                    let mut inner = without_tests(group.stream());
                    if variants && group.delimiter() == Delimiter::Brace {
                        // Names of variants are declared here; what they hold stands in brackets.
                        inner.retain(|token| matches!(token, TokenTree::Group(_)));
                        variants = false;
                    }
                    self.walk(&inner);
                }
                _ => {}
            }
            at += 1;
        }
    }

    /// Takes in a tree of names after `use`.
    fn used(&mut self, tree: &[TokenTree], prefix: &[String], exported: bool) {
        for branch in tree.split(|token| is_punct(Some(token), ',')) {
            let mut path = prefix.to_vec();
            let mut name = None;
            for (at, token) in branch.iter().enumerate() {
                match token {
                    // From another crate, whatever stands here.
                    TokenTree::Punct(_) if at == 0 && prefix.is_empty() && is_punct(Some(token), ':') => break,
                    TokenTree::Ident(word) if word == "as" => {
                        name = branch.get(at + 1).map(ToString::to_string);
                        break;
                    }
                    TokenTree::Ident(word) if word == "self" && !path.is_empty() => {}
                    TokenTree::Ident(word) => path.push(word.to_string()),
                    TokenTree::Punct(star) if star.as_char() == '*' => path.push("*".to_owned()),
                    TokenTree::Group(group) => {
                        self.used(&group.stream().into_iter().collect::<Vec<_>>(), &path, exported);
                        path.clear();
                    }
                    _ => {}
                }
            }
            if let Some(last) = path.last() {
                self.uses.push(Use { name: name.unwrap_or_else(|| last.clone()), path, exported });
            }
        }
    }
}

fn child_of(module: &Module, name: &str) -> Module {
    let mut child = module.clone();
    child.push(name.to_owned());
    child
}

/// Tokens without the items that only tests compile.
fn without_tests(tokens: TokenStream) -> Vec<TokenTree> {
    let tokens: Vec<TokenTree> = tokens.into_iter().collect();
    let mut kept = Vec::new();
    let mut at = 0;
    while at < tokens.len() {
        let attribute = if is_punct(tokens.get(at), '#') { tokens.get(at + 1) } else { None };
        if attribute.is_some_and(only_tests) {
            // The item ends with the first braces or semicolon.
            while at < tokens.len() && !is_body(tokens.get(at)) && !is_punct(tokens.get(at), ';') {
                at += 1;
            }
        } else {
            kept.push(tokens[at].clone());
        }
        at += 1;
    }
    kept
}

/// Whether an attribute is a `cfg` that asks for tests, or `test` itself.
fn only_tests(attribute: &TokenTree) -> bool {
    let text = attribute.to_string().replace(' ', "");
    let asks = text.contains("(test)") || text.contains("(test,") || text.contains(",test)");
    text == "[test]" || (text.starts_with("[cfg(") && asks && !text.contains("not(") && !text.contains("any("))
}

/// Modules that a piece of source declares, with their bodies where these stand there.
fn modules_in(tokens: &[TokenTree]) -> Vec<(String, Option<Group>)> {
    let mut modules = Vec::new();
    for window in tokens.windows(3) {
        match window {
            [TokenTree::Ident(word), TokenTree::Ident(name), TokenTree::Group(body)]
                if word == "mod" && body.delimiter() == Delimiter::Brace =>
            {
                modules.push((name.to_string(), Some(body.clone())));
            }
            [TokenTree::Ident(word), TokenTree::Ident(name), end] if word == "mod" && is_punct(Some(end), ';') => {
                modules.push((name.to_string(), None));
            }
            _ => {}
        }
    }
    modules
}

/// Names of the items that a piece of source defines, those in brackets left out.
fn items_in(tokens: &[TokenTree]) -> BTreeSet<String> {
    const DEFINING: [&str; 8] = ["fn", "struct", "enum", "union", "trait", "type", "const", "static"];
    let mut items = BTreeSet::new();
    for (at, token) in tokens.iter().enumerate() {
        let TokenTree::Ident(word) = token else { continue };
        let after = tokens.get(at + 1);
        if DEFINING.iter().any(|defining| word == defining) {
            items.extend(after.map(ToString::to_string));
        } else if word == "macro_rules" && is_punct(after, '!') {
            items.extend(tokens.get(at + 2).map(ToString::to_string));
        }
    }
    items
}

/// The names of a path, from a name on that no `::` precedes.
fn path_at(tokens: &[TokenTree], start: usize) -> Vec<String> {
    let mut path = vec![tokens[start].to_string()];
    let mut at = start;
    while is_punct(tokens.get(at + 1), ':') && is_punct(tokens.get(at + 2), ':') {
        let Some(TokenTree::Ident(name)) = tokens.get(at + 3) else { break };
        path.push(name.to_string());
        at += 3;
    }
    path
}

/// Whether a name is a field or method of what stands before it, or goes on with a path.
fn continues(tokens: &[TokenTree], at: usize) -> bool {
    let before = |back: usize, character| at >= back && is_punct(tokens.get(at - back), character);
    (before(1, '.') && !before(2, '.')) || (before(1, ':') && before(2, ':'))
}

/// Whether the token is the bracket of a visibility: `pub(...)`.
fn restricted(tokens: &[TokenTree], at: usize) -> bool {
    let bracket =
        matches!(tokens.get(at), Some(TokenTree::Group(group)) if group.delimiter() == Delimiter::Parenthesis);
    bracket && at > 0 && is_ident(tokens.get(at - 1), "pub")
}

/// Whether a group is the argument of `quote!`: its tokens are those of another program.
fn quoted(tokens: &[TokenTree], at: usize) -> bool {
    let [quote, mark] = [2, 1].map(|back| at.checked_sub(back).and_then(|at| tokens.get(at)));
    is_ident(quote, "quote") && is_punct(mark, '!')
}

fn is_punct(token: Option<&TokenTree>, character: char) -> bool {
    matches!(token, Some(TokenTree::Punct(punct)) if punct.as_char() == character)
}

fn is_ident(token: Option<&TokenTree>, name: &str) -> bool {
    matches!(token, Some(TokenTree::Ident(ident)) if ident == name)
}

fn is_body(token: Option<&TokenTree>) -> bool {
    matches!(token, Some(TokenTree::Group(group)) if group.delimiter() == Delimiter::Brace)
}
