"""Learning from labelled frames: layout fitting, classifiers, structured SVM."""
