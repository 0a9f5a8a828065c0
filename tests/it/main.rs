//! Tests of the built product from outside; one binary, one module per subject.

mod ipc;
