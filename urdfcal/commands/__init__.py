"""The commands of the command line, one file a group; `urdfcal.cli` puts them together."""
