//! Why a port could not be opened or used.

/// Why a port could not be opened or used.
#[derive(Debug, thiserror::Error)]
pub enum PortError {
    /// The domain's name cannot be used.
    #[error("domain '{name}': {cause}; use 1 to 32 letters, digits, '-' or '_'")]
    BadDomain {
        /// As it was given.
        name: String,
        /// What is wrong.
        cause: String,
    },
    /// Another launcher runs in the domain.
    #[error(
        "domain '{domain}' is in use by the launcher with pid {pid}; stop it (evac down) or choose another --domain"
    )]
    DomainInUse {
        /// The domain.
        domain: String,
        /// Who holds it; 0 if it does not say.
        pid: u32,
    },
    /// The two sides of a service were built with different layouts.
    #[error(
        "service '{service}': this build speaks {ours}, the running pipeline {theirs}; build both from one version, or stop the pipeline first"
    )]
    LayoutMismatch {
        /// The service.
        service: &'static str,
        /// Our layout's name and hash.
        ours: String,
        /// Theirs.
        theirs: String,
    },
    /// The middleware refused.
    #[error("service '{service}': cannot {action}: {cause}; {remedy}")]
    Refused {
        /// The service.
        service: &'static str,
        /// What was tried.
        action: &'static str,
        /// The middleware's word.
        cause: String,
        /// What to try.
        remedy: &'static str,
    },
}

impl PortError {
    pub(crate) fn refused(service: &'static str, action: &'static str, cause: impl std::fmt::Debug) -> Self {
        let cause = format!("{cause:?}");
        let remedy = if cause.contains("Permission") {
            "run all stages as one user"
        } else if cause.contains("Exceeds") || cause.contains("Requested") {
            "too many stages share the service: stop some of them"
        } else if cause.contains("Memory") || cause.contains("Resource") {
            "free some shared memory (/dev/shm)"
        } else {
            "stop all stages of the domain and start again"
        };
        Self::Refused { service, action, cause, remedy }
    }
}
