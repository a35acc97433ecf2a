"""The occ-recon command."""
