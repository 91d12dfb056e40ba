//! Settings that are one of several named values.

/// An enumeration whose values have names. The derive macros of `strum` read names and descriptions from the type itself:
/// `#[derive(strum::Display, strum::EnumMessage, strum::IntoStaticStr, strum::VariantArray)]`, with `#[strum(serialize_all = "...")]` as of
/// serde where it has one. Whoever offers the choice, a command line or a window, lists [`strum::VariantArray::VARIANTS`].
pub trait Choice: Copy + strum::VariantArray + strum::EnumMessage + Into<&'static str> {
    /// The name in settings and files.
    fn name(self) -> &'static str {
        self.into()
    }

    /// What the value means: the first paragraph of its documentation as one line, without the full stop.
    fn about(self) -> String {
        let text = self.get_documentation().unwrap_or_default();
        let paragraph: Vec<&str> = text.lines().map(str::trim).take_while(|line| !line.is_empty()).collect();
        paragraph.join(" ").trim_end_matches('.').to_owned()
    }

    /// The value of that name.
    fn named(name: &str) -> Option<Self> {
        Self::VARIANTS.iter().copied().find(|value| value.name() == name)
    }
}

impl<T: Copy + strum::VariantArray + strum::EnumMessage + Into<&'static str>> Choice for T {}
