least(f)={
  my(batch=1,times=List(),t,start);
  while(1,t=getabstime();for(i=1,batch,f());if(getabstime()-t>=20,break);batch*=2);
  start=getabstime();
  while(getabstime()-start<1000*seconds||#times<5,t=getabstime();for(i=1,batch,f());listput(times,(getabstime()-t)/batch));
  1000.*vecmin(Vec(times));
};
collect(p,e)={if(type(p)!="t_POL",if(p,listput(out,[p,e])),my(v=mapget(number,variable(p)),g=e);for(d=0,poldegree(p),g[v]=d;collect(polcoef(p,d),g)))};
terms(p)={out=List();collect(p,vector(#names));out};
factors(e)={for(i=1,#names,if(e[i],print1(" ",names[i],"^",e[i])));print()};
