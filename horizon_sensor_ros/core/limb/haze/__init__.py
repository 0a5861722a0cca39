"""The limb under air so thick that it hides the ground: ``passes`` (look for it), ``sample`` (what
is seen), ``column`` (the air along rays from within it), ``limb`` (the fit).
"""
