"""Model bundles: displacement models, priors and policies."""
