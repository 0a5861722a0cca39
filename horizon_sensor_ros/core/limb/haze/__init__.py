"""The limb under air so thick that it hides the ground: ``passes`` (look for it), ``sample`` (what
is seen), ``limb`` (the fit).
"""
