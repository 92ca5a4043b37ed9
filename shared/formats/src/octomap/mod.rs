//! OctoMap `.ot` and `.bt`.
