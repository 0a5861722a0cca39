"""What the night's airglow, a layer above the limb, tells of nadir and altitude: ``nadir`` (joined
with the ground's limb), ``alone`` (where no ground shows).
"""
