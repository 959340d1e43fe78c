"""`python -m circumnav_mav`: the circumnav command."""

from circumnav_mav.cli import main

main()
