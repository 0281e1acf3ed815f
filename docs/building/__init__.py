"""What the site has beside the pages: parts of Sphinx, each small."""
