"""The documentation's figures, one file a figure; `doc/make_pictures.py` draws them all."""
