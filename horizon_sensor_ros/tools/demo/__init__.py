"""A simulated flight past the real nodes: the command `horizon_demo`.

``demo`` (the command), ``flight_past_nodes``, ``failures`` (why there is none), ``rendering``
(draws images and clouds ahead), ``processes`` (the nodes), ``link`` (publishes and listens),
``recording`` (a bag of all), ``screen`` (what shows meanwhile).
"""
