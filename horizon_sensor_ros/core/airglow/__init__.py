"""What the night's airglow, a layer above the limb, tells of nadir and altitude."""
