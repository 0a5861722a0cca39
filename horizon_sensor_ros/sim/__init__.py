"""Simulators with exact truth: the Earth camera, a flight around the planet, the range camera.

Images: ``earth_camera`` draws an ``earth_scene`` with its ``frame_truth``; ``cloud_texture`` and
``smooth_texture`` (the ground), ``air``, ``sky``, ``exposure`` (motion), ``recording`` (light to
gray levels). Sets of them: ``scene_sets``, ``hard_scenes``, ``sun_alone``, ``flight``. Clouds:
``tof_camera``, ``shapes``, ``tumbling``, ``paper_d``. ``poses`` (cameras and attitudes for all).
"""
