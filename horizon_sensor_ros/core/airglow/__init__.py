"""What the night's airglow, a layer above the limb, tells of nadir and altitude.

``edge`` (its upper edge in one frame, a limb of its own), ``nadir`` (joined with the ground's
limb), ``alone`` (where no ground shows).
"""
