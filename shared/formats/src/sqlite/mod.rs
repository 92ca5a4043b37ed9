//! Reads the tables of an SQLite 3 file row by row (<https://www.sqlite.org/fileformat2.html>): what a ROS 2 bag of kind
//! db3 needs, and no more. No index, no query, no writing.

mod pages;
mod record;
mod table;

pub(crate) use pages::Database;
pub(crate) use record::Value;
pub(crate) use table::{Row, Table};
