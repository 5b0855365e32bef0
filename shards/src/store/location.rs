//! The location of a dataset: a folder, or a prefix in an object store.

use std::ffi::OsStr;
use std::fmt::{self, Display, Formatter};
use std::path::{Path, PathBuf};

use url::Url;

/// The location of a dataset or of one of its files. Displayed as the path or the URL.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Location {
    /// A path on a disk.
    Path(PathBuf),
    /// A URL of an object store or a web server.
    Url(Box<Url>),
}

/// Schemes of URLs that can be read, besides `file`.
const SCHEMES: [&str; 9] = ["s3", "s3a", "gs", "az", "azure", "abfs", "abfss", "http", "https"];

impl Location {
    /// A line on URLs, for `--help`.
    pub const HELP: &str = "\
A dataset lies in a folder or behind a URL: s3://bucket/prefix, gs://bucket/prefix, az://container/prefix, \
https://host/path, file:///path. Endpoints and credentials come from the environment: AWS_ENDPOINT_URL, AWS_ALLOW_HTTP, \
AWS_ACCESS_KEY_ID, AWS_SECRET_ACCESS_KEY, AWS_REGION, AWS_SKIP_SIGNATURE, GOOGLE_SERVICE_ACCOUNT, \
AZURE_STORAGE_ACCOUNT_NAME, AZURE_STORAGE_ACCOUNT_KEY and so on. A shard of a store is copied to TMPDIR before it is read.";

    /// A path, or a URL if it contains `://` after a scheme.
    ///
    /// # Errors
    /// What is wrong, if the scheme is unknown, the URL has no host or bucket, or it has parts that a dataset's
    /// files cannot have: a query, or a password, which belongs in the environment.
    pub fn parse(text: impl AsRef<OsStr>) -> Result<Self, String> {
        let text = text.as_ref();
        if text.is_empty() {
            return Err("a place must not be empty: is a variable unset?".to_owned());
        }
        let path = || Ok(Self::Path(PathBuf::from(text)));
        let Some(written) = text.to_str() else { return path() };
        let Some((scheme, _)) = written.split_once("://") else { return path() };
        if !scheme.starts_with(|c: char| c.is_ascii_alphabetic())
            || scheme.contains(|c: char| !c.is_ascii_alphanumeric() && !['+', '-', '.'].contains(&c))
        {
            return path();
        }
        let url = Url::parse(written).map_err(|e| format!("not a URL: {e}"))?;
        if url.query().is_some() || url.fragment().is_some() {
            return Err("the URL must have neither ? nor #: the dataset's files lie below it".to_owned());
        }
        if url.scheme() == "file" {
            let path = url.to_file_path().map(Self::Path);
            return path.map_err(|()| "a file URL must be file:///path".to_owned());
        }
        if !SCHEMES.contains(&url.scheme()) {
            let known = SCHEMES.join(", ");
            return Err(format!("the scheme must be file, {known}, got {}", url.scheme()));
        }
        if url.host_str().unwrap_or_default().is_empty() {
            return Err(format!("the URL must be {}://bucket/prefix", url.scheme()));
        }
        // `abfss://container@account` is no credential; a name before a web server may be a token.
        if url.password().is_some() || (url.scheme().starts_with("http") && !url.username().is_empty()) {
            return Err("credentials must be in the environment, not in the URL".to_owned());
        }
        Ok(Self::Url(Box::new(url)))
    }

    /// Its last part, for titles.
    #[must_use]
    pub fn name(&self) -> String {
        let text = self.to_string();
        let name = text.trim_end_matches('/').rsplit('/').next().unwrap_or_default();
        if [".", "..", ""].contains(&name) { "dataset".to_owned() } else { name.to_owned() }
    }

    /// The location of a file below this one.
    #[must_use]
    pub fn join(&self, name: &str) -> Self {
        match self {
            Self::Path(path) => Self::Path(path.join(name)),
            Self::Url(url) => {
                let mut url = url.clone();
                url.set_path(&format!("{}/{name}", url.path().trim_end_matches('/')));
                Self::Url(url)
            }
        }
    }
}

impl Display for Location {
    fn fmt(&self, f: &mut Formatter<'_>) -> fmt::Result {
        match self {
            Self::Path(path) => write!(f, "{}", path.display()),
            Self::Url(url) => write!(f, "{url}"),
        }
    }
}

impl From<&Path> for Location {
    fn from(path: &Path) -> Self {
        Self::Path(path.to_owned())
    }
}

impl From<&PathBuf> for Location {
    fn from(path: &PathBuf) -> Self {
        Self::Path(path.clone())
    }
}

impl From<&Location> for Location {
    fn from(location: &Location) -> Self {
        location.clone()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn shown(text: &str) -> String {
        match Location::parse(text) {
            Ok(Location::Path(path)) => format!("path {}", path.display()),
            Ok(Location::Url(url)) => format!("url {url}"),
            Err(e) => format!("error: {e}"),
        }
    }

    #[test]
    fn paths_and_urls_are_told_apart() {
        for path in ["data/demo", "/data/demo", "s3:bucket", "a b/://c", "-x://y"] {
            assert_eq!(shown(path), format!("path {path}"));
        }
        assert_eq!(shown("file:///data/a%20b"), "path /data/a b");
        for url in
            ["s3://bucket/a/b", "gs://bucket/a", "az://container/a", "https://example.org/a/", "http://[::1]:80/a"]
        {
            assert!(shown(url).starts_with("url "), "{}", shown(url));
        }
        assert_eq!(shown("s3://bucket/a b"), "url s3://bucket/a%20b");
    }

    #[test]
    fn what_is_no_place_is_refused() {
        for (text, part) in [
            ("", "must not be empty"),
            ("ftp://host/x", "must be file, s3, s3a, gs"),
            ("s3:///x", "must be s3://bucket/prefix"),
            ("s3://", "must be s3://bucket/prefix"),
            ("https://me:secret@host/x", "in the environment"),
            ("https://host/x?token=1", "neither ? nor #"),
            ("http://[/x", "not a URL"),
        ] {
            assert!(shown(text).starts_with("error: ") && shown(text).contains(part), "{text}: {}", shown(text));
        }
    }

    #[test]
    fn files_lie_below() {
        for root in ["s3://bucket/a", "s3://bucket/a/"] {
            let file = Location::parse(root).unwrap().join("meta/info.json");
            assert_eq!(file.to_string(), "s3://bucket/a/meta/info.json");
        }
        let root = Location::parse("s3://bucket").unwrap();
        assert_eq!(root.join("meta/info.json").to_string(), "s3://bucket/meta/info.json");
    }
}
