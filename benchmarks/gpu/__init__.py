"""Commands for a CUDA card: one short run of all that it must show, and a longer table of cases."""
