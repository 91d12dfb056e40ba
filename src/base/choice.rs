//! Settings that are one of several named values.

/// Declares enumerations whose values have names, first how these are spelled: `choice! { "kebab-case", /// ... pub enum Name { ... } }`.
/// Names and descriptions are read from the type itself: the same names stand in files (serde), are printed (`Display`) and are read on
/// the command line. Whoever offers the choice, a command line or a window, lists [`strum::VariantArray::VARIANTS`].
macro_rules! choice {
    ($spelling:literal, $(#[$attribute:meta])* $visibility:vis enum $name:ident { $($values:tt)* }) => {
        $(#[$attribute])*
        #[derive(
            Debug,
            Clone,
            Copy,
            PartialEq,
            Eq,
            serde::Serialize,
            serde::Deserialize,
            strum::Display,
            strum::EnumMessage,
            strum::IntoStaticStr,
            strum::VariantArray,
        )]
        #[serde(rename_all = $spelling)]
        #[strum(serialize_all = $spelling)]
        $visibility enum $name {
            $($values)*
        }
    };
}
pub(crate) use choice;

/// A setting that is one of several named values, as the macro `choice` declares it.
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
