"""How fast the pipeline is beside a bare decoder, and how many feeds a machine carries.

``films`` makes the videos and ``coded`` writes them, ``contestants`` are what is timed side by
side, ``stopwatch`` takes their times, ``trial`` lets them take turns, ``feeds`` adds feeds until
one falls behind, and the tables say it.
"""
