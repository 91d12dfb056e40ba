//! Pictures by Cycles, cached by content.
