"""``python -m occ_recon_ros`` is the occ-recon command."""

from occ_recon_ros.cli import main

raise SystemExit(main())
