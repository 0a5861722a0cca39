"""Simulators with exact truth: the Earth camera, a flight around the planet, the range camera.

Images: ``earth_camera`` draws an ``earth_scene`` with its ``frame_truth``: ``scene_light`` (what is
along lines of sight: ``cloud_texture`` and ``smooth_texture`` of the ground, ``air``),
``supersampled_limb``, ``sky`` (Sun, Moon, stars), ``exposure`` (motion), ``recording`` (light to
gray levels). Sets of them: ``scene_sets``, ``hard_scenes`` of ``hard_kinds``, ``sun_alone``,
``flight``. Clouds: ``tof_camera``, ``swept_scan``, ``shapes``, ``tumbling``, ``paper_d``. ``poses``
(cameras and attitudes for all).
"""
