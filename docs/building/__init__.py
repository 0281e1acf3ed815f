"""Extensions of Sphinx for the site, each small."""
