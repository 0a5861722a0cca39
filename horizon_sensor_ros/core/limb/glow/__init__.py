"""The limb under air that glows above it."""
