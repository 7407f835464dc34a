"""One thin program per box of the picture: load the config, open the streams, loop the stage."""
